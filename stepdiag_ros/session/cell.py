"""Which nodes a simulated measurement needs, and with which parameters."""

import time
from pathlib import Path

from stepdiag_ros.session.processes import NodeProcess


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
        NodeProcess("assembler", simulated),
        NodeProcess("solver", simulated),
        NodeProcess("evaluator", simulated),
        NodeProcess("diagnosis", {**simulated, "model": model}),
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
