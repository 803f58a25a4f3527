"""Which nodes a measurement needs, in the simulated cell or on a machine, and a replay."""

import time
from pathlib import Path

from stepdiag_ros.processes.cell_file import check_cell_file
from stepdiag_ros.processes.node_process import NodeProcess


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
    simulated: dict[str, object] = {"use_sim_time": True}
    # The air that the beam feels and the air that the sensors feel are the same.
    weather = {**simulated, "device": "simulated", "cell": cell, "weather_begins": time.time_ns()}
    return [
        NodeProcess("clock", {"factor": factor}),
        NodeProcess("recorder", {**simulated, "folder": folder}),
        *evaluation(model),
        NodeProcess("weather", weather),
        NodeProcess(
            "bridge",
            {
                **simulated,
                "device": "simulated",
                "machine": machine,
                "cell": cell,
                "correction": correction,
                # A computer that is busy with all nodes at once is not a danger to this machine.
                "silence_limit": 2.0,
            },
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
    return [
        NodeProcess("recorder", {"folder": folder}),
        NodeProcess("assembler"),
        NodeProcess("solver"),
        NodeProcess("evaluator"),
        NodeProcess("diagnosis", {"model": model}),
        NodeProcess("weather", weather),
        NodeProcess("bridge", {"device": driver, "device_file": device_file, "machine": machine}),
        # No reading is made without the position of its own time, however late messages are.
        NodeProcess(
            "interferometer",
            {**weather, "seed": seed, "hold_after": 3600.0, "weather_age": 3600.0},
        ),
        NodeProcess("sequencer", {"plan": plan, "machine": machine, "cell": cell}),
    ]
