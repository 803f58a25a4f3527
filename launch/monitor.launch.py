"""What looks on, here or elsewhere: ros2 launch stepdiag_ros monitor.launch.py rviz:=true.

It moves nothing and changes nothing: frames and markers of the run and of its errors, and RViz.
"""

from launch import LaunchDescription
from launch_ros.actions import Node

from stepdiag_ros import resources, topics
from stepdiag_ros.scene.frames import MACHINE
from stepdiag_ros.session.launching import (
    NAMESPACE,
    TRUTHS,
    Argument,
    description,
    started,
)
from stepdiag_ros.session.processes import NodeProcess
from stepdiag_ros.topics import TOPICS

ARGUMENTS = {
    "namespace": NAMESPACE,
    "frame_prefix": Argument(
        "before the names of all frames, such as cell_1/, where several cells share /tf", ""
    ),
    "use_sim_time": Argument("true beside a simulated cell or a replay", "false", TRUTHS),
    "rviz": Argument("start RViz", "false", TRUTHS),
    "rviz_config": Argument(
        "what RViz shows", str(resources.directory("config") / "rviz" / "stepdiag.rviz")
    ),
}


def generate_launch_description() -> LaunchDescription:
    """Return the scene, and RViz if it is wanted."""

    def start(values):
        simulated = values["use_sim_time"] == "true"
        namespace = values["namespace"]
        prefix = values["frame_prefix"]
        scene = NodeProcess("scene", {"use_sim_time": simulated, "frame_prefix": prefix})
        actions = started([scene], namespace)
        if values["rviz"] == "true":
            # The names in RViz's configuration are those without a namespace.
            names = [(topics.absolute(one), topics.absolute(one, namespace)) for one in TOPICS]
            actions.append(
                Node(
                    package="rviz2",
                    executable="rviz2",
                    arguments=["-d", values["rviz_config"], "-f", prefix + MACHINE],
                    parameters=[{"use_sim_time": simulated}],
                    remappings=[(plain, full) for plain, full in names if plain != full],
                    output="screen",
                )
            )
        return actions

    return description(ARGUMENTS, start)
