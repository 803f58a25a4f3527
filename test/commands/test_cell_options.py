"""``stepdiag cell``: which options fit a machine, and which the simulated cell."""

from pathlib import Path

import pytest
from refused import refused

from stepdiag_ros import cli
from stepdiag_ros.cli import make_parser
from stepdiag_ros.commands.cell import _nodes
from stepdiag_ros.metrology.refusal import Refusal

DEVICES = ("cnc_bridge", "interferometer", "weather")


@pytest.fixture
def cell_file(tmp_path):
    def written(recorder="{}"):
        path = tmp_path / "cell.yaml"
        rows = [f"/**/{name}: {{ros__parameters: {{device: simulated}}}}" for name in DEVICES]
        path.write_text("\n".join([*rows, f"/**/recorder: {{ros__parameters: {recorder}}}"]))
        return str(path)

    return written


def nodes_for(*arguments):
    return _nodes(make_parser().parse_args(["cell", *arguments]))


def test_the_nodes_of_a_machine_take_the_file_and_the_namespace(cell_file, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = cell_file("{folder: runs}")
    nodes, folder = nodes_for("--parameters", path, "--namespace", "cell_1")
    assert folder == tmp_path / "runs"
    assert {node.name for node in nodes} > {"bridge", "sequencer", "recorder"}
    assert not any(node.name == "clock" or node.parameters for node in nodes)
    for node in nodes:
        command = " ".join(node.command())
        assert f"--params-file {path} " in command and command.endswith("-r __ns:=/cell_1")
    nodes, folder = nodes_for("--parameters", cell_file())
    assert folder == tmp_path and "__ns" not in " ".join(nodes[0].command())


@pytest.mark.parametrize(
    ("node", "parameter"),
    [
        ("sequencer", "machine"),
        ("sequencer", "plan"),
        ("cnc_bridge", "device_file"),
        ("diagnosis", "model"),
    ],
)
def test_a_file_that_the_cell_needs_is_looked_for_before_its_nodes_start(
    cell_file, node, parameter
):
    path = Path(cell_file())
    device = "device: simulated, " if node in DEVICES else ""
    values = f"{{{device}{parameter}: /nowhere/x.yaml}}"
    rows = [row for row in path.read_text().splitlines() if f"/{node}:" not in row]
    path.write_text("\n".join([*rows, f"/**/{node}: {{ros__parameters: {values}}}"]))
    with refused(ValueError, None, "cell.yaml", "/nowhere/x.yaml"):
        nodes_for("--parameters", str(path))


CONTROLLER = """
controller: /gantry_controller
controller_manager: /controller_manager
joints: {X: [{name: x}], Y: [{name: y_left}, {name: y_right}], Z: [{name: z, factor: -1.0}]}
acceleration_m_per_s2: [0.5, 0.5, 0.5]
"""


@pytest.mark.parametrize(
    ("wrong", "right", "named"),
    [
        ("factor", "factor", ()),
        ("factor", "facter", ("cell.yaml", "gantry.yaml", "facter", "factor")),
        ("name: z", "name: x", ("cell.yaml", "gantry.yaml")),
        ("ros2_control", "ros2control", ("cell.yaml", "cnc_bridge", "ros2_control")),
        ("machine: demo", "machine: gantry", ("cell.yaml", "demo", "gantry", "cnc_bridge")),
    ],
)
def test_a_wrong_device_or_machine_is_refused_before_any_node_starts(wrong, right, named, tmp_path):
    cell, device = tmp_path / "cell.yaml", tmp_path / "gantry.yaml"
    bridge = f"{{device: ros2_control, device_file: {device}, machine: demo}}"
    rows = [f"cnc_bridge: {{ros__parameters: {bridge}}}"]
    rows += [f"{name}: {{ros__parameters: {{device: simulated}}}}" for name in DEVICES[1:]]
    device.write_text(CONTROLLER.replace(wrong, right))
    cell.write_text("\n".join(rows).replace(wrong, right))
    if not named:
        assert nodes_for("--parameters", str(cell))
        return
    with refused(Refusal, None, *named):
        nodes_for("--parameters", str(cell))


def test_the_simulated_cell_has_its_defaults(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    nodes, folder = nodes_for("--factor", "7")
    given = {node.name: node.parameters for node in nodes}
    assert given["clock"]["factor"] == 7.0 and given["sequencer"]["plan"].endswith("demo.yaml")
    assert folder == tmp_path / "stepdiag_results"


@pytest.mark.parametrize("on_machine", [True, False])
def test_the_node_of_an_archive_is_there_if_one_is_named(
    on_machine, cell_file, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    given = ["--parameters", cell_file()] if on_machine else []
    assert all(node.name != "archive" for node in nodes_for(*given)[0])
    nodes, _ = nodes_for(*given, "--archive", "s3://plant/machines", "--namespace", "cell_1")
    (archive,) = [node for node in nodes if node.name == "archive"]
    assert archive.parameters["place"] == "s3://plant/machines"
    assert ("use_sim_time" in archive.parameters) != on_machine
    assert "-r __ns:=/cell_1" in " ".join(archive.command())


def test_a_tolerance_reaches_the_solver_in_metres(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    given = {node.name: node.parameters for node in nodes_for("--tolerance", "10")[0]}
    assert given["solver"]["tolerance"] == pytest.approx(10e-6)
    assert not any("tolerance" in own for name, own in given.items() if name != "solver")
    assert all("tolerance" not in node.parameters for node in nodes_for()[0])


def test_a_namespace_can_be_rehearsed_in_the_simulated_cell(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    nodes, _ = nodes_for("--plan", "quick", "--namespace", "/cell_1")
    assert {node.name for node in nodes} > {"clock", "sequencer", "bridge"}
    for node in nodes:
        assert "-r __ns:=/cell_1 " in " ".join(node.command())


@pytest.mark.parametrize(
    "option", ["--plan=demo", "--factor=1", "--seed=0", "--output=here", "--tolerance=5"]
)
def test_what_describes_the_simulated_cell_is_refused_for_a_machine(option, cell_file, capsys):
    assert cli.main(["cell", "--parameters", cell_file(), option]) == 1
    assert option.partition("=")[0] in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["--parameters", "nowhere.yaml"], "nowhere.yaml"),
    ],
)
def test_what_is_missing_is_named(arguments, named, capsys):
    assert cli.main(["cell", *arguments]) == 1
    said = capsys.readouterr().err
    assert named in said and said.count("\n") == 1
