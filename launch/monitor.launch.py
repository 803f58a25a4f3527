"""What looks on, here or elsewhere: ros2 launch stepdiag_ros monitor.launch.py rviz:=true.

Frames and markers of the run and of its errors, and RViz, which move and change nothing; with
page:=true the live page too, from which whoever has its token may start and end a run, and with
foxglove:=true a server for Foxglove viewers, which look on.
"""

from launch import LaunchDescription
from launch_ros.actions import Node

from stepdiag_ros import resources, topics
from stepdiag_ros.metrology.frames import MACHINE
from stepdiag_ros.processes.launching import (
    NAMESPACE,
    TRUTHS,
    Argument,
    description,
    number,
    started,
)
from stepdiag_ros.processes.node_process import NodeProcess
from stepdiag_ros.topics import TOPICS

ARGUMENTS = {
    "namespace": NAMESPACE,
    "frame_prefix": Argument(
        "before the names of all frames, such as cell_1/, where several cells share /tf", ""
    ),
    "use_sim_time": Argument("true beside a simulated cell or a replay", "false", TRUTHS),
    "page": Argument("serve the live page", "false", TRUTHS),
    "page_address": Argument("that the page is served on", "127.0.0.1"),
    "page_port": Argument("that the page is served on; 0: any that is free", "8470"),
    "token_file": Argument("whose first line is the token of the page", ""),
    "foxglove": Argument("serve Foxglove viewers", "false", TRUTHS),
    "foxglove_address": Argument("that Foxglove viewers connect to", "127.0.0.1"),
    "foxglove_port": Argument("that Foxglove viewers connect to; 0: any that is free", "8765"),
    "foxglove_open_to_network": Argument(
        "true: other computers may reach foxglove_address; everybody there may look on",
        "false",
        TRUTHS,
    ),
    "rviz": Argument("start RViz", "false", TRUTHS),
    "rviz_config": Argument(
        "what RViz shows", str(resources.directory("config") / "rviz" / "stepdiag.rviz")
    ),
}


def generate_launch_description() -> LaunchDescription:
    """Return the scene, and page, Foxglove's server and RViz if they are wanted."""

    def start(values):
        simulated = values["use_sim_time"] == "true"
        namespace = values["namespace"]
        prefix = values["frame_prefix"]
        scene = NodeProcess("scene", {"use_sim_time": simulated, "frame_prefix": prefix})
        nodes = [scene]
        if values["page"] == "true":
            page = {
                "address": values["page_address"],
                "port": int(number(values, "page_port")),
                "token_file": values["token_file"],
            }
            nodes.append(NodeProcess("monitor", {"use_sim_time": simulated, **page}))
        if values["foxglove"] == "true":
            served = {
                "address": values["foxglove_address"],
                "port": int(number(values, "foxglove_port")),
                "open_to_network": values["foxglove_open_to_network"] == "true",
            }
            nodes.append(NodeProcess("foxglove_server", {"use_sim_time": simulated, **served}))
        actions = started(nodes, namespace)
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
