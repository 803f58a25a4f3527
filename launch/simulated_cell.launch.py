"""A whole measurement in the simulated cell: ros2 launch stepdiag_ros simulated_cell.launch.py.

Nothing moves before a run is started, with the action /sequencer/measure or the service
/sequencer/start.
"""

from pathlib import Path

from launch import LaunchDescription

from stepdiag_ros.processes.cell import archiving, simulated_cell
from stepdiag_ros.processes.launching import ARCHIVE, Argument, description, number, started

ARGUMENTS = {
    "plan": Argument("test plan: YAML file, or a name in config/plans", "demo"),
    "machine": Argument("machine: YAML file, or a name in config/machines", "demo"),
    "cell": Argument("simulated cell: YAML file, or a name in config/cells", "demo"),
    "model": Argument("model that the run is compared with: YAML file, or a name", "free"),
    "folder": Argument("where the bags are written", "."),
    "factor": Argument("simulated seconds in a real second", "1.0"),
    "rate": Argument("readings in a simulated second; 0: the cell's own", "0.0"),
    "seed": Argument("of the noise of the simulated readings", "0"),
    "correction": Argument(
        "error map by which the bridge corrects every target, volumetric_map.json of 'stepdiag"
        " compensate --for generic'; empty: targets are sent as they are",
        "",
    ),
    "archive": ARCHIVE,
}


def generate_launch_description() -> LaunchDescription:
    """Return the nodes of the simulated cell."""
    return description(
        ARGUMENTS,
        lambda values: started(
            [
                *simulated_cell(
                    plan=values["plan"],
                    machine=values["machine"],
                    cell=values["cell"],
                    folder=Path(values["folder"]),
                    factor=number(values, "factor"),
                    rate=number(values, "rate"),
                    seed=int(number(values, "seed")),
                    model=values["model"],
                    correction=values["correction"],
                ),
                *archiving(values["archive"], simulated=True),
            ]
        ),
    )
