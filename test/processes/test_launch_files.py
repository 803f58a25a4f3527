"""Launch files: arguments, nodes and parameters, as far as they can be checked without ROS 2."""

import re
import sys
from pathlib import Path
from types import SimpleNamespace

import fake_launch
import pytest
import yaml
from refused import a_fault, refused

from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.parameters.documents import parameter_file
from stepdiag_ros.parameters.nodes import NODES, declared_node
from stepdiag_ros.processes.cell_file import check_cell_file

ROOT = Path(__file__).parents[2]
FILES = {path.name.removesuffix(".launch.py"): path for path in (ROOT / "launch").iterdir()}
EVALUATION = ["assembler", "solver", "evaluator", "diagnosis"]
DEVICES = ["weather", "bridge", "interferometer"]


@pytest.fixture
def launched(monkeypatch):
    for name, module in fake_launch.modules().items():
        monkeypatch.setitem(sys.modules, name, module)
    yield lambda name, **values: fake_launch.launched(FILES[name], **values)
    sys.modules.pop("stepdiag_ros.processes.launching", None)


@pytest.fixture
def cell_file(tmp_path):
    path = tmp_path / "cell.yaml"
    path.write_text(parameter_file(NODES))
    return path


def kind(action):
    return type(action).__name__


def parameters(action):
    """Return the parameters of a node that do not come from a file."""
    given = {}
    for source in action.options["parameters"]:
        if isinstance(source, dict):
            given.update(source)
    return {
        name: value.arguments[0] if kind(value) == "ParameterValue" else value
        for name, value in given.items()
    }


def test_simulated_devices_of_different_cells_are_refused(tmp_path):
    path = tmp_path / "cell.yaml"
    given = {
        "sequencer": {"cell": "demo"},
        "interferometer": {"device": "simulated", "cell": "demo"},
        "weather": {"device": "simulated", "cell": "hidden_backlash"},
        "cnc_bridge": {"device": "simulated", "cell": "demo"},
    }

    def write():
        path.write_text(yaml.dump({"/**": {n: {"ros__parameters": p} for n, p in given.items()}}))
        return str(path)

    with refused(Refusal, "mismatch", "weather", about="cell"):
        check_cell_file(write())
    given["weather"]["cell"] = "demo"
    check_cell_file(write())
    # A run of a real machine has no cell, whatever the sequencer's default would be.
    given["sequencer"]["cell"] = ""
    check_cell_file(write())


def test_there_are_the_launch_files_that_the_documentation_names():
    assert set(FILES) == {"simulated_cell", "measure", "by_hand", "replay", "monitor"}


@pytest.mark.parametrize("name", FILES)
def test_every_argument_is_described(launched, cell_file, name):
    cell = {"parameters": str(cell_file)}
    required = {"measure": cell, "by_hand": cell, "replay": {"bag": "run.mcap"}}
    arguments, actions = launched(name, **required.get(name, {}))
    for options in arguments.values():
        assert len(options["description"]) >= 10
    must = {name for name, options in arguments.items() if options["default_value"] is None}
    assert must == set(required.get(name, {}))
    for action in actions:
        if "executable" not in action.options:
            continue
        node = declared_node(action.options["executable"])
        assert node in NODES
        assert action.options["name"] == node.name
        assert (kind(action) == "LifecycleNode") == (action.options["executable"] in DEVICES)
        for parameter, value in parameters(action).items():
            node.check(parameter, value)


def executables(actions):
    return [action.options["executable"] for action in actions if "executable" in action.options]


def test_a_simulated_cell_runs_in_simulated_time_in_one_weather(launched):
    _, actions = launched("simulated_cell", factor="20", folder="/tmp/12", seed="7")
    assert sorted(executables(actions)) == sorted(
        ["clock", "recorder", *EVALUATION, *DEVICES, "sequencer"]
    )
    given = {action.options["executable"]: parameters(action) for action in actions}
    clock = given.pop("clock")
    assert clock["factor"] == 20.0 and not clock["use_sim_time"]
    assert all(values["use_sim_time"] for name, values in given.items() if name != "clock")
    assert given["recorder"]["folder"] == "/tmp/12"
    assert given["interferometer"]["seed"] == 7
    assert given["interferometer"]["weather_begins"] == given["weather"]["weather_begins"] > 0
    with refused(Refusal, "malformed", "fast"):
        launched("simulated_cell", factor="fast")
    with refused(Refusal, "out_of_range", "factor", "0.0"):
        launched("simulated_cell", factor="0")


def test_a_simulated_cell_corrects_targets_if_asked(launched):
    for given in ("", "map/volumetric_map.json"):
        _, actions = launched("simulated_cell", correction=given)
        (bridge,) = (one for one in actions if one.options["executable"] == "bridge")
        assert parameters(bridge)["correction"] == given


def ends(action, code, is_shutdown=False):
    """Return what is said if the process of an action ends so; empty if nothing else ends."""
    on_exit = action.options.get("on_exit")
    if on_exit is None:
        return ""
    try:
        on_exit(SimpleNamespace(returncode=code), SimpleNamespace(is_shutdown=is_shutdown))
    except RuntimeError as error:
        return str(error)
    return ""


@pytest.mark.parametrize("name", FILES)
def test_a_node_that_a_run_needs_ends_the_launch_when_it_fails(launched, cell_file, name):
    cell = {"parameters": str(cell_file)}
    required = {"measure": cell, "by_hand": cell, "replay": {"bag": "run.mcap"}}
    _, actions = launched(name, **required.get(name, {"page": "true", "rviz": "true"}))
    needed = [action for action in actions if ends(action, 1)]
    for action in needed:
        # What has done its work ends nothing, nor what was killed, nor the end of the launch.
        assert not ends(action, 0) and not ends(action, -9) and not ends(action, 1, True)
        called = action.options.get("executable", "replay")
        assert re.match(rf"the {called}( node)? has ended \(exit code 1\)", ends(action, 1))
    others = [one.options["executable"] for one in actions if one not in needed]
    looking_on = ["scene", "monitor", "rviz2"]
    left_over = {"monitor": looking_on, "replay": []}.get(name, ["evaluator", "diagnosis"])
    assert others == left_over


def test_by_hand_nothing_is_started_that_moves_a_machine(launched, cell_file):
    _, actions = launched("by_hand", parameters=str(cell_file))
    names = [action.options["executable"] for action in actions if "executable" in action.options]
    assert {"by_hand", "interferometer", "recorder", *EVALUATION} <= set(names)
    assert not {"bridge", "sequencer"} & set(names)


def test_a_machine_is_measured_with_the_parameters_of_one_file(launched, cell_file):
    _, actions = launched("measure", parameters=str(cell_file), namespace="cell_1")
    assert sorted(executables(actions)) == sorted(
        ["recorder", *EVALUATION, *DEVICES, "sequencer"]
    ), "and no clock"
    for action in actions:
        assert action.options["parameters"] == [str(cell_file)]
        assert action.options["namespace"] == "cell_1"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("/**/cnc_bridge:", "/**/cnc_brigde:", a_fault("unknown", "cnc_brigde", "cnc_bridge")),
        (
            "/**/cnc_bridge:",
            "/cell_2/cnc_bridge:",
            a_fault("unknown", "/cell_2/cnc_bridge", "/cell_1/cnc_bridge"),
        ),
        (
            r"    position_rate: 50.0",
            r"    positionrate: 50.0",
            a_fault("unknown", "positionrate", "position_rate"),
        ),
        (
            r"    position_rate: 50.0",
            r"    position_rate: 50",
            a_fault("out_of_range", "position_rate", "50"),
        ),
        (
            r"(cnc_bridge:\n(.*\n)*?)    device: 'simulated'\n",
            r"\1",
            a_fault("missing", "device", "cnc_bridge"),
        ),
        (r"\A", "- ", a_fault()),
    ],
)
def test_a_file_that_does_not_fit_the_cell_is_refused(launched, cell_file, old, new, message):
    old = old if "\\" in old else re.escape(old)
    text, count = re.subn(old, new, cell_file.read_text(), count=1)
    assert count == 1
    cell_file.write_text(text)
    with refused(ValueError, message) as info:
        launched("measure", parameters=str(cell_file), namespace="cell_1")
    assert str(cell_file) in str(info.value)


def test_a_file_for_all_namespaces_fits_any():
    pytest.importorskip("yaml")
    with refused(ValueError, None, "cell.yaml"):
        check_cell_file("/nowhere/cell.yaml")


def test_a_replay_begins_when_the_nodes_that_evaluate_listen(launched):
    _, actions = launched("replay", bag="run.mcap", rate="20")
    assert executables(actions) == EVALUATION
    assert all(parameters(action)["use_sim_time"] for action in actions[:-1])
    program, *words = actions[-1].options["cmd"]
    assert program.options == {"package": "stepdiag_ros", "executable": "stepdiag"}
    assert words == ["replay", "run.mcap", "--rate", "20", "--wait-for", *EVALUATION]

    from stepdiag_ros.cli import make_parser

    understood = make_parser().parse_args(words)
    assert understood.wait_for == EVALUATION and understood.rate == 20.0


def test_a_monitor_starts_rviz_only_if_asked(launched):
    arguments, actions = launched("monitor")
    assert executables(actions) == ["scene"]
    assert parameters(actions[0]) == {"use_sim_time": False, "frame_prefix": ""}
    assert Path(arguments["rviz_config"]["default_value"]).is_file()
    given = {"use_sim_time": "true", "namespace": "cell_1", "frame_prefix": "cell_1/"}
    _, (scene, rviz) = launched("monitor", rviz="true", **given)
    assert parameters(scene) == {"use_sim_time": True, "frame_prefix": "cell_1/"}
    assert parameters(rviz) == {"use_sim_time": True}
    assert rviz.options["arguments"][-2:] == ["-f", "cell_1/machine"]
    assert ("/result/error_markers", "/cell_1/result/error_markers") in rviz.options["remappings"]
    assert all(not plain.startswith("/tf") for plain, _ in rviz.options["remappings"])


def test_every_message_package_that_the_code_uses_is_a_dependency():
    manifest = (ROOT / "package.xml").read_text()
    used = set()
    for path in (ROOT / "stepdiag_ros").rglob("*.py"):
        if "embedded" not in path.parts:
            imported = r"^\s*from (\w+)\.(?:msg|srv|action) import"
            used |= set(re.findall(imported, path.read_text(), re.MULTILINE))
            used |= set(re.findall(r'"(\w+)/msg/\w+"', path.read_text()))
    for definition in (*(ROOT / "msg").iterdir(), *(ROOT / "action").iterdir()):
        used |= set(re.findall(r"^(\w+)/\w+", definition.read_text(), re.MULTILINE))
    assert len(used) > 8
    for package in used - {"stepdiag_ros"}:
        assert f"depend>{package}<" in manifest, package
