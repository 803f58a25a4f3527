"""Which nodes a measurement needs, in the simulated cell or on a machine, and a replay."""

import time
from pathlib import Path

from stepdiag_ros.configuration import load_plan
from stepdiag_ros.parameters.declaration import HEARTBEAT_TIMEOUT
from stepdiag_ros.parameters.nodes import declared_node
from stepdiag_ros.processes.cell_file import check_cell_file
from stepdiag_ros.processes.node_process import NodeProcess

PATIENT = {
    "heartbeat_timeout": 10.0,
    "silence_limit": 10.0,
    "position_timeout": 10.0,
    "reading_timeout": 15.0,
}
"""Limits of real time in a simulated cell, s: its machine is in no danger from a busy computer."""

_POSITION_RATE = 500.0
"""Hz, of the controller where lines are measured on the fly."""


def simulated_node(name: str, **parameters: object) -> NodeProcess:
    """Return a node of a simulated cell: on simulated time, and patient.

    Args:
        name: of the module in ``stepdiag_ros.nodes``.
        parameters: beside these; they take precedence.
    """
    known = {one.name for one in declared_node(name).parameters} | {HEARTBEAT_TIMEOUT.name}
    patient = {limit: value for limit, value in PATIENT.items() if limit in known}
    return NodeProcess(name, {"use_sim_time": True, **patient, **parameters})


def evaluation(model: str = "free") -> list[NodeProcess]:
    """Return the nodes that evaluate a simulated or recorded run, in its own time.

    Args:
        model: YAML file or name of the model that the run is compared with.
    """
    return [
        *(simulated_node(name) for name in ("assembler", "solver", "evaluator")),
        simulated_node("diagnosis", model=model),
    ]


def archiving(place: str, simulated: bool) -> list[NodeProcess]:
    """Return the node that adds the bag of each run to an archive; none for an empty ``place``.

    Args:
        place: of the archive: a folder, or a URL.
        simulated: the nodes beside it are on simulated time.
    """
    if not place:
        return []
    made = simulated_node("archive", place=place)
    return [made if simulated else NodeProcess("archive", {"place": place})]


def machine_cell(parameter_file: str, namespace: str = "") -> list[NodeProcess]:
    """Return the nodes of a measurement on a machine; their parameters are in the file.

    Args:
        parameter_file: in the usual form of ROS 2.
        namespace: in which the nodes will be.

    Raises:
        ValueError: the file does not fit the nodes; says where.
    """
    check_cell_file(parameter_file, namespace)
    evaluating = [NodeProcess(node.name) for node in evaluation()]
    devices = [NodeProcess(name) for name in ("weather", "bridge", "interferometer")]
    return [NodeProcess("recorder"), *evaluating, *devices, NodeProcess("sequencer")]


def hand_cell(parameter_file: str, namespace: str = "") -> list[NodeProcess]:
    """Return the nodes of a measurement whose machine follows its own NC program.

    Args:
        parameter_file: in the usual form of ROS 2.
        namespace: in which the nodes will be.

    Raises:
        ValueError: the file does not fit the nodes; says where.
    """
    left_out = ("bridge", "sequencer")
    connected = machine_cell(parameter_file, namespace)
    return [*(node for node in connected if node.name not in left_out), NodeProcess("by_hand")]


def simulated_cell(
    plan: str,
    machine: str,
    cell: str,
    folder: Path,
    factor: float,
    rate: float,
    seed: int,
    model: str = "free",
    correction: str = "",
) -> list[NodeProcess]:
    """Return the nodes of a measurement in the simulated cell.

    Args:
        plan: YAML file or name of the test plan.
        machine: YAML file or name of the machine.
        cell: YAML file or name of the simulated cell.
        folder: where the bag goes.
        factor: simulated seconds in a real second.
        rate: readings of the interferometer in a simulated second; 0 for the cell's own.
        seed: of the noise of the readings.
        model: YAML file or name of the model that the run is compared with.
        correction: error map by which the bridge corrects targets; empty for none.
    """
    # The air that the beam feels and the air that the sensors feel are the same.
    simulated = {"device": "simulated", "cell": cell}
    weather: dict[str, object] = {**simulated, "weather_begins": time.time_ns()}
    return [
        simulated_node("clock", use_sim_time=False, factor=factor),
        simulated_node("recorder", folder=folder),
        *evaluation(model),
        simulated_node("weather", **weather),
        simulated_node(
            "bridge", **simulated, machine=machine, correction=correction, **_moving(plan)
        ),
        # However late messages are when the computer is busy, no reading is made without the
        # position and the weather of its own time.
        simulated_node(
            "interferometer", **weather, rate=rate, seed=seed, hold_after=3600.0, weather_age=3600.0
        ),
        simulated_node("sequencer", plan=plan, machine=machine, cell=cell),
    ]


def _moving(plan: str) -> dict[str, object]:
    """Return what the bridge needs for a plan's lines on the fly."""
    return {"position_rate": _POSITION_RATE} if load_plan(plan)[0].on_the_fly else {}


def twin_cell(
    plan: str,
    machine: str,
    cell: str,
    folder: Path,
    driver: str,
    device_file: str,
    seed: int = 1,
    model: str = "free",
) -> list[NodeProcess]:
    """Return the nodes of a measurement on a real controller, with a simulated laser as its twin.

    They run on the computer's clock. The twin is fed with what the bridge publishes of the motors,
    so that it feels the controller's compensation as a machine would.

    Args:
        plan: YAML file or name of the test plan.
        machine: YAML file or name of the machine.
        cell: YAML file or name of the simulated cell: the errors of the twin.
        folder: where the bag goes.
        driver: of the controller.
        device_file: settings of the driver.
        seed: of the noise of the readings.
        model: YAML file or name of the model that the run is compared with.
    """
    weather: dict[str, object] = {
        "device": "simulated",
        "cell": cell,
        "weather_begins": time.time_ns(),
    }
    device = {"device": driver, "device_file": device_file, "machine": machine}
    return [
        NodeProcess("recorder", {"folder": folder}),
        NodeProcess("assembler"),
        NodeProcess("solver"),
        NodeProcess("evaluator"),
        NodeProcess("diagnosis", {"model": model}),
        NodeProcess("weather", weather),
        NodeProcess("bridge", {**device, **_moving(plan)}),
        # No reading is made without the position of its own time, however late messages are.
        NodeProcess(
            "interferometer",
            {**weather, "seed": seed, "hold_after": 3600.0, "weather_age": 3600.0},
        ),
        NodeProcess("sequencer", {"plan": plan, "machine": machine, "cell": cell}),
    ]
