"""Which nodes a measurement needs, in the simulated cell or on a machine, and a replay."""

import time
from pathlib import Path

from stepdiag_ros.session.cell_file import check_cell_file
from stepdiag_ros.session.processes import NodeProcess


def evaluation(model: str = "free") -> list[NodeProcess]:
    """Return the nodes that evaluate a simulated or recorded run, in its own time.

    Args:
        model: YAML file or name of the model that the run is compared with.
    """
    simulated: dict[str, object] = {"use_sim_time": True}
    return [
        NodeProcess("assembler", simulated),
        NodeProcess("solver", simulated),
        NodeProcess("evaluator", simulated),
        NodeProcess("diagnosis", {**simulated, "model": model}),
    ]


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


def simulated_cell(
    plan: str,
    machine: str,
    cell: str,
    folder: Path,
    factor: float,
    rate: float,
    seed: int,
    model: str = "free",
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
    """
    simulated: dict[str, object] = {"use_sim_time": True}
    # The air that the beam feels and the air that the sensors feel are the same.
    weather = {**simulated, "device": "simulated", "cell": cell, "weather_begins": time.time_ns()}
    return [
        NodeProcess("clock", {"factor": factor}),
        NodeProcess("recorder", {**simulated, "folder": folder}),
        *evaluation(model),
        NodeProcess("weather", weather),
        NodeProcess(
            "bridge", {**simulated, "device": "simulated", "machine": machine, "cell": cell}
        ),
        NodeProcess(
            "interferometer",
            {
                **weather,
                "rate": rate,
                "seed": seed,
                # However late messages are when the computer is busy, no reading is made without
                # the position and the weather of its own time.
                "hold_after": 3600.0,
                "weather_age": 3600.0,
            },
        ),
        NodeProcess("sequencer", {**simulated, "plan": plan, "machine": machine, "cell": cell}),
    ]
