"""The nodes of a measurement on a machine: ros2 launch stepdiag_ros measure.launch.py.

What the cell is made of stands in one ROS 2 parameter file; `stepdiag parameters --yaml` prints one
to be edited. Nothing moves before a run is started, with the action sequencer/measure or the
service sequencer/start; devices are opened at once unless their parameter autostart is false.
"""

from launch import LaunchDescription

from stepdiag_ros.processes.cell import archiving, machine_cell
from stepdiag_ros.processes.launching import ARCHIVE, NAMESPACE, Argument, description, started

ARGUMENTS = {
    "parameters": Argument("ROS 2 parameter file with the devices and parameters of the cell"),
    "namespace": NAMESPACE,
    "archive": ARCHIVE,
}


def generate_launch_description() -> LaunchDescription:
    """Return the nodes of a measurement."""
    return description(
        ARGUMENTS,
        lambda values: started(
            [
                *machine_cell(values["parameters"], values["namespace"]),
                *archiving(values["archive"], simulated=False),
            ],
            values["namespace"],
            [values["parameters"]],
        ),
    )
