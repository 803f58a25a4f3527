"""Action types: what ROS 2 derives from the goal, result and feedback of an ``.action`` file.

An action is two services and a topic of its own, plus the cancel service and the status topic,
which all actions share. The derived messages and the order of their members are those of the ROS 2
interface generators, so that type names, CDR and type hashes equal those of a generated package.
"""

from __future__ import annotations

from collections.abc import Callable

from .definitions import Definition, Field, FieldType

_GOAL_ID = Field("goal_id", FieldType("unique_identifier_msgs/msg/UUID"))
_STAMP = Field("stamp", FieldType("builtin_interfaces/msg/Time"))
#: Ends of the names of an action's parts, the longest first where one ends like another.
_ENDS = (
    "_SendGoal_Request",
    "_SendGoal_Response",
    "_GetResult_Request",
    "_GetResult_Response",
    "_FeedbackMessage",
    "_Feedback",
    "_Result",
    "_Goal",
)


def action_of(name: str) -> str:
    """Return the action to which a message ``package/action/Name_Part`` belongs."""
    for end in _ENDS:
        if name.endswith(end):
            return name.removesuffix(end)
    return name


def wire_services(name: str) -> tuple[str, str]:
    """Return the names of an action's own two services."""
    return f"{name}_SendGoal", f"{name}_GetResult"


def wire_definitions(name: str) -> tuple[Definition, ...]:
    """Return the messages that carry an action's goal, result and feedback over the wire."""

    def define(part: str, *fields: Field) -> Definition:
        return Definition(f"{name}_{part}", fields, {})

    def nested(member: str, part: str) -> Field:
        return Field(member, FieldType(f"{name}_{part}"))

    return (
        define("SendGoal_Request", _GOAL_ID, nested("goal", "Goal")),
        define("SendGoal_Response", Field("accepted", FieldType("bool")), _STAMP),
        define("GetResult_Request", _GOAL_ID),
        define(
            "GetResult_Response", Field("status", FieldType("int8")), nested("result", "Result")
        ),
        define("FeedbackMessage", _GOAL_ID, nested("feedback", "Feedback")),
    )


def make_class(
    name: str, message_class: Callable[[str], type], service_class: Callable[[str], type]
) -> type:
    """Return the class of an action.

    Args:
        name: The action, ``package/action/Name``.
        message_class: Gives the class of a message by its full name.
        service_class: Gives the class of a service by its full name.
    """
    package, kind, short = name.split("/")
    send_goal, get_result = wire_services(name)
    wire = type(
        "Impl",
        (),
        {
            "__module__": f"{package}.{kind}",
            "__doc__": f"What the action {name} sends over the wire.",
            "SendGoalService": service_class(send_goal),
            "GetResultService": service_class(get_result),
            "FeedbackMessage": message_class(f"{name}_FeedbackMessage"),
            "CancelGoalService": service_class("action_msgs/srv/CancelGoal"),
            "GoalStatusMessage": message_class("action_msgs/msg/GoalStatusArray"),
        },
    )
    return type(
        short,
        (),
        {
            "__module__": f"{package}.{kind}",
            "__doc__": f"Action class '{short}' ({name}).",
            "_ACTION": name,
            "Goal": message_class(f"{name}_Goal"),
            "Result": message_class(f"{name}_Result"),
            "Feedback": message_class(f"{name}_Feedback"),
            "Impl": wire,
        },
    )
