"""A recorded run, evaluated again: ros2 launch stepdiag_ros replay.launch.py bag:=RUN.mcap.

The nodes that evaluate run in the time of the recording, which comes with it on /clock; so must
whatever looks on: ros2 launch stepdiag_ros monitor.launch.py use_sim_time:=true.
"""

from launch import LaunchDescription
from launch.actions import ExecuteProcess
from launch_ros.substitutions import ExecutableInPackage

from stepdiag_ros.processes.cell import evaluation
from stepdiag_ros.processes.launching import (
    PACKAGE,
    Argument,
    description,
    ends_launch,
    number,
    started,
)

ARGUMENTS = {
    "bag": Argument("the recorded run (.mcap)"),
    "rate": Argument("recorded seconds in a real second; 0: as fast as the nodes take it", "1.0"),
    "model": Argument("model that the run is compared with: YAML file, or a name", "free"),
}


def generate_launch_description() -> LaunchDescription:
    """Return the nodes that evaluate, and the replay that begins when they listen."""

    def start(values):
        nodes = evaluation(values["model"])
        rate = number(values, "rate")
        player = ExecuteProcess(
            cmd=[
                ExecutableInPackage(package=PACKAGE, executable="stepdiag"),
                *("replay", values["bag"], "--rate", f"{rate:.15g}"),
                *("--wait-for", *(node.name for node in nodes)),
            ],
            output="screen",
            on_exit=ends_launch("the replay"),
        )
        # The replay waits for all of them.
        return [*started(nodes, dispensable=()), player]

    return description(ARGUMENTS, start)
