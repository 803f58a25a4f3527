"""The nodes of a measurement by hand: ros2 launch stepdiag_ros by_hand.launch.py.

For a machine that follows its own NC program, and a laser interferometer that is connected. What
the cell is made of stands in one ROS 2 parameter file; `stepdiag parameters --yaml` prints one to
be edited. The run begins with the service by_hand/start; nothing here moves the machine.
"""

from launch import LaunchDescription

from stepdiag_ros.processes.cell import hand_cell
from stepdiag_ros.processes.launching import NAMESPACE, Argument, description, started

ARGUMENTS = {
    "parameters": Argument("ROS 2 parameter file with the devices and parameters of the cell"),
    "namespace": NAMESPACE,
}


def generate_launch_description() -> LaunchDescription:
    """Return the nodes of a measurement by hand."""
    return description(
        ARGUMENTS,
        lambda values: started(
            hand_cell(values["parameters"], values["namespace"]),
            values["namespace"],
            [values["parameters"]],
        ),
    )
