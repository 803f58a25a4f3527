"""A whole measurement in the simulated cell: ros2 launch stepdiag_ros simulated_cell.launch.py."""

import time

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from launch import LaunchDescription

ARGUMENTS = {
    "plan": ("demo", "test plan: YAML file, or a name in config/plans"),
    "machine": ("demo", "machine: YAML file, or a name in config/machines"),
    "cell": ("demo", "simulated cell: YAML file, or a name in config/cells"),
    "model": ("free", "model that the run is compared with: YAML file, or a name in config/models"),
    "folder": (".", "where the bag is written"),
    "factor": ("1.0", "simulated seconds in a real second"),
}


def generate_launch_description() -> LaunchDescription:
    """Return the nodes of the simulated cell; start a run with the service /sequencer/start."""

    def text(name: str) -> ParameterValue:
        return ParameterValue(LaunchConfiguration(name), value_type=str)

    def node(name: str, **parameters: object) -> Node:
        return Node(
            package="stepdiag_ros",
            executable=name,
            output="screen",
            parameters=[{"use_sim_time": name != "clock", **parameters}],
        )

    # The air that the beam feels and the air that the sensors feel are the same.
    weather = {"device": "simulated", "cell": text("cell"), "weather_begins": time.time_ns()}
    factor = ParameterValue(LaunchConfiguration("factor"), value_type=float)
    return LaunchDescription(
        [
            *[
                DeclareLaunchArgument(name, default_value=default, description=description)
                for name, (default, description) in ARGUMENTS.items()
            ],
            node("clock", factor=factor),
            node("recorder", folder=text("folder")),
            node("assembler"),
            node("solver"),
            node("evaluator"),
            node("diagnosis", model=text("model")),
            node("weather", **weather),
            node("bridge", device="simulated", machine=text("machine"), cell=text("cell")),
            node("interferometer", **weather),
            node("sequencer", plan=text("plan"), machine=text("machine"), cell=text("cell")),
        ]
    )
