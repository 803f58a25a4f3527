"""Which message packages can be served; kept free of imports because every failed import asks."""

from __future__ import annotations

from pathlib import Path

#: The package whose definitions are this project's own.
OWN = "stepdiag_ros"

#: Folder with the fields of the standard interfaces that nodes use: the facts of the wire, no more.
TEXTS = Path(__file__).parent / "interfaces"

#: Packages which the rosbags type store of ROS 2 Jazzy has, and ``interfaces/`` only in part.
FROM_ROSBAGS = frozenset(
    (
        "action_msgs",
        "geometry_msgs",
        "lifecycle_msgs",
        "nav_msgs",
        "sensor_msgs",
        "service_msgs",
        "shape_msgs",
        "statistics_msgs",
        "std_msgs",
        "stereo_msgs",
        "tf2_msgs",
        "trajectory_msgs",
        "type_description_interfaces",
        "unique_identifier_msgs",
        "visualization_msgs",
    )
)

_SERVED = FROM_ROSBAGS | {OWN} | {path.name for path in TEXTS.iterdir() if path.is_dir()}


def is_served(package: str) -> bool:
    """Return whether messages or services of this package can be made."""
    return package in _SERVED
