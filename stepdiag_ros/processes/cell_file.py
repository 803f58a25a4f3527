"""The ROS 2 parameter file that says what a real cell is made of, checked before nodes start.

ROS leaves out what is meant for no node, so that a node whose name is misspelt would silently run
with its defaults; on a machine that could be a simulated device in place of a real one.
"""

from collections.abc import Callable, Iterable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

from stepdiag_ros.configuration import (
    load_cell,
    load_device,
    load_machine,
    load_model,
    plan_given,
)
from stepdiag_ros.devices import NO_DRIVER, Kind, Surroundings, prepare
from stepdiag_ros.devices.cnc.joint_controller import ControllerNames, JointController
from stepdiag_ros.embedded.arguments import load_parameter_file, matches
from stepdiag_ros.metrology.refusal import Refusal, fields_of
from stepdiag_ros.metrology.spelling import nearest, suggestion
from stepdiag_ros.parameters.declaration import DeclaredNode
from stepdiag_ros.parameters.nodes import NODES
from stepdiag_ros.run.accord import SIMULATED

DEVICE = "device"
"""Parameter of every node that owns a device: its driver."""
_KINDS: dict[str, Kind] = {
    "cnc_bridge": "cnc",
    "interferometer": "interferometer",
    "weather": "weather",
}
"""Node that owns a device → kind of its driver."""
_FILES = {
    "machine": load_machine,
    "plan": plan_given,
    "cell": load_cell,
    "model": load_model,
    "device_file": load_device,
}
"""Parameter that names a file → what reads it."""


def check_cell_file(path: str, namespace: str = "") -> None:
    """Refuse a parameter file that does not fit the nodes of a cell.

    Args:
        path: of the file, in the usual form of ROS 2.
        namespace: in which the nodes will be.

    Raises:
        ValueError: the file cannot be read, is meant for a node or parameter that is not there,
            holds a value that its node would refuse, names a file that cannot be used, or leaves
            open which driver a device has.
    """
    names = _names(namespace)
    given = given_to(path, names)
    try:
        for name, node in names.items():
            _check(node, given[name])
        by_node = {node.name: given[name] for name, node in names.items()}
        _check_machines(by_node)
        _check_cells(by_node)
    except ValueError as error:
        raise Refusal(f"{path}: {error}", **fields_of(error)) from None


def folder_of_bags(path: str, namespace: str = "") -> Path:
    """Return the folder in which the recorder of a cell writes its bags.

    Args:
        path: of the parameter file.
        namespace: in which the nodes will be.

    Raises:
        ValueError: the file cannot be read, or is meant for a node that is not there.
    """
    ((name, recorder),) = (
        (name, node) for name, node in _names(namespace).items() if node.name == "recorder"
    )
    given = given_to(path, _names(namespace))[name]
    return Path(given.get("folder", recorder.find("folder").default)).expanduser().resolve()


def _names(namespace: str) -> dict[str, DeclaredNode]:
    """Return full name, without the first slash → node."""
    return {f"{namespace.strip('/')}/{node.name}".lstrip("/"): node for node in NODES}


def given_to(path: str, names: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Return the parameters that a file gives each node.

    Args:
        path: of the file, in the usual form of ROS 2.
        names: full names of the nodes, without the first slash.

    Raises:
        ValueError: the file cannot be read, or is meant for a node that is not there.
    """
    given: dict[str, dict[str, Any]] = {name: {} for name in names}
    if not Path(path).exists():
        raise Refusal(
            f"there is no parameter file {path}. 'stepdiag parameters --yaml > cell.yaml' writes"
            " one with all defaults",
            fault="not_found",
        )
    for pattern, values in load_parameter_file(path):
        meant = [name for name in given if matches(pattern, f"/{name}")]
        if not meant:
            raise Refusal(f"{path}: {_no_node(pattern, given)}", fault="unknown")
        for name in meant:
            given[name].update(values)
    return given


def _check(node: DeclaredNode, given: dict[str, Any]) -> None:
    for name, value in given.items():
        node.check(name, value)
        if value and name in _FILES:
            _FILES[name](value)
    own = [declaration.name for declaration in node.parameters]
    if DEVICE in own and DEVICE not in given:
        raise Refusal(
            f"there is no '{DEVICE}' for {node.name}; say which driver it has, even if that is"
            f" '{node.find(DEVICE).default}'",
            fault="missing",
        )
    if DEVICE in own:
        _check_driver(_KINDS[node.name], node, given)


def _check_driver(kind: Kind, node: DeclaredNode, given: dict[str, Any]) -> None:
    """Refuse a driver that is not there, and settings that it would refuse; nothing is opened."""
    driver = given[DEVICE]
    if driver == SIMULATED:
        return
    file = given.get("device_file", "")
    settings = load_device(file)[0] if file else {}
    surroundings = Surroundings(joint_controller=_of_the_node)
    if kind == "cnc":
        settings["position_rate_hz"] = _value(node, given, "position_rate")
        surroundings = replace(
            surroundings, machine=load_machine(_value(node, given, "machine"))[0]
        )
    try:
        prepare(kind, driver, settings, surroundings)
    except ValueError as error:
        fields = fields_of(error)
        if fields.get("aspect") == NO_DRIVER:
            where = f"'{DEVICE}' of {node.name}"
        else:
            where = file or f"'{DEVICE}' of {node.name} without a device_file"
        raise Refusal(f"{where}: {error}", **fields) from None


def _of_the_node(names: ControllerNames) -> JointController:
    raise NotImplementedError(f"{names}: a controller is asked by the node alone")


def _value(node: DeclaredNode, given: dict[str, Any], name: str) -> Any:
    return given.get(name, node.find(name).default)


def _check_machines(given: dict[str, dict[str, Any]]) -> None:
    """Refuse a sequencer and a bridge that would have different machines: no run would start."""
    default = next(node for node in NODES if node.name == "sequencer").find("machine").default
    used = [(node, given[node].get("machine", default)) for node in ("sequencer", "cnc_bridge")]
    _check_same("machine", used, lambda file: load_machine(file)[0])


def _check_cells(given: dict[str, dict[str, Any]]) -> None:
    """Refuse simulated devices that would be of different cells, or of another than the run's."""
    nodes = {node.name: node for node in NODES}
    used = [
        (name, _value(nodes[name], given[name], "cell"))
        for name in ("sequencer", *_KINDS)
        if name == "sequencer" or given[name][DEVICE] == SIMULATED
    ]
    _check_same(
        "cell", [(name, cell) for name, cell in used if cell], lambda file: load_cell(file)[1]
    )


def _check_same(about: str, used: list[tuple[str, str]], load: Callable[[str], Any]) -> None:
    """Refuse files that differ where nodes (name, file) must have the same."""
    for (one, first), (other, second) in pairwise(used):
        if load(first) != load(second):
            raise Refusal(
                f"the {about} of the {one} ({first}) and of {other} ({second}) differ: name the"
                " same file for both",
                fault="mismatch",
                about=about,
            )


def _no_node(pattern: str, names: Iterable[str]) -> str:
    plain = pattern.rpartition("/")[2]
    near = nearest(plain, [name.rpartition("/")[2] for name in names])
    there = f"the nodes are {', '.join(f'/{name}' for name in sorted(names))}"
    return f"'{pattern}' is not a node; {suggestion(near if near != plain else '', there)}"
