"""Shapes and placements to the messages that viewers know: markers and transforms."""

from collections.abc import Iterable
from typing import Any

from stepdiag_ros.messages.fields import set_header
from stepdiag_ros.messages.types import new_message
from stepdiag_ros.metrology.frames import MACHINE, Placement
from stepdiag_ros.viewers.scene.shapes import Kind, Shape

MARKER_ARRAY = "visualization_msgs/msg/MarkerArray"
TRANSFORMS = "tf2_msgs/msg/TFMessage"

_TYPES = {
    Kind.ARROW: "ARROW",
    Kind.BOX: "CUBE",
    Kind.LINES: "LINE_LIST",
    Kind.PATH: "LINE_STRIP",
    Kind.TEXT: "TEXT_VIEW_FACING",
}
_PLACED = (Kind.BOX, Kind.TEXT)
"""Kinds that have a pose instead of points."""
# RViz draws texts with a font of few letters, byte by byte.
_ASCII = str.maketrans({"µ": "u", "±": "+/-", "×": "x", "°": " deg", "–": "-", "’": "'"})


def from_shapes(shapes: Iterable[Shape], time: int, prefix: str = "") -> Any:
    """Make a ``MarkerArray`` that takes the place of every marker before it on its topic.

    Each message is the whole picture, so that a viewer that comes late or misses one shows nothing
    that no longer holds.

    Args:
        shapes: all that is to be seen.
        time: of what is shown, ns.
        prefix: put before the names of frames.
    """
    array = new_message(MARKER_ARRAY)
    first = new_message("visualization_msgs/msg/Marker")
    first.action = type(first).DELETEALL
    set_header(first, time, prefix + MACHINE)
    array.markers = [first, *(_marker(shape, time, prefix) for shape in shapes)]
    return array


def _marker(shape: Shape, time: int, prefix: str) -> Any:
    marker = new_message("visualization_msgs/msg/Marker")
    set_header(marker, time, prefix + shape.frame)
    marker.ns = shape.group
    marker.id = shape.number
    marker.type = getattr(type(marker), _TYPES[shape.kind])
    marker.action = type(marker).ADD
    marker.pose.orientation.w = 1.0
    marker.scale.x, marker.scale.y, marker.scale.z = (float(part) for part in shape.size)
    # Wherever its frame is now, not where it was at the time of the header.
    marker.frame_locked = True
    if shape.kind in _PLACED:
        _set_point(marker.pose.position, shape.points[0])
    else:
        marker.points = [
            _set_point(new_message("geometry_msgs/msg/Point"), point) for point in shape.points
        ]
    _set_colour(marker.color, shape.colours[0])
    if len(shape.colours) > 1:
        marker.colors = [
            _set_colour(new_message("std_msgs/msg/ColorRGBA"), colour) for colour in shape.colours
        ]
    marker.text = shape.text.translate(_ASCII)
    return marker


def _set_point(point: Any, values: Any) -> Any:
    point.x, point.y, point.z = (float(value) for value in values)
    return point


def _set_colour(colour: Any, values: Any) -> Any:
    colour.r, colour.g, colour.b, colour.a = (float(value) for value in values)
    return colour


def from_placements(placements: Iterable[Placement], time: int, prefix: str = "") -> Any:
    """Make a ``TFMessage`` of where frames are.

    Args:
        placements: of the frames.
        time: at which they are there, ns.
        prefix: put before the names of frames.
    """
    message = new_message(TRANSFORMS)
    transforms = []
    for placement in placements:
        stamped = new_message("geometry_msgs/msg/TransformStamped")
        set_header(stamped, time, prefix + placement.parent)
        stamped.child_frame_id = prefix + placement.child
        _set_point(stamped.transform.translation, placement.translation)
        turn = stamped.transform.rotation
        turn.x, turn.y, turn.z, turn.w = placement.rotation
        transforms.append(stamped)
    message.transforms = transforms
    return message
