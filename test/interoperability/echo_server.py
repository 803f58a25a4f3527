"""One side of the interoperability check: answers whatever the other side asks.

Run by a test, in an environment with either client. Public rclpy interface only.
"""

from __future__ import annotations

import itertools
import random
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import random_content
from random_content import content

import stepdiag_ros.client  # noqa: F401 - makes rclpy importable where no ROS 2 is

# isort: split
import rclpy
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger

SERVER, MANAGED, SPACE = "interop_server", "interop_managed", "/interop"
ACTION = "stepdiag_ros/action/Measure"
GOAL_SEED, FEEDBACK_SEED, RESULT_SEED = 1, 2, 3
DEEP = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
LATCHED = QoSProfile(
    depth=5,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
LATCHED_SENT = 8
ANSWER = "served: µm ↑"
"""Text of the Trigger service, with signs of two and three bytes."""


def topic(direction: str, type_name: str) -> str:
    """Return the topic of a message type, there or back."""
    return f"{SPACE}/{direction}/{type_name.replace('/msg/', '_').lower()}"


def _echo(back: Any) -> Callable[[Any], None]:
    """Return what publishes messages as objects and as bytes, two of each in turn."""
    as_bytes = itertools.cycle((False, False, True, True))

    def echo(message: Any) -> None:
        back.publish(serialize_message(message) if next(as_bytes) else message)

    return echo


class Server(Node):
    """Echoes messages; offers services, parameters, an action, and what was said before."""

    def __init__(self) -> None:
        super().__init__(SERVER)
        self._latched = self.create_publisher(String, f"{SPACE}/latched", LATCHED)
        for number in range(LATCHED_SENT):
            self._latched.publish(String(data=f"latched {number}"))
        for type_name in random_content.message_types():
            try:
                cls = random_content.load(type_name)
            except ImportError as error:
                print(error, flush=True)
                continue
            back = self.create_publisher(cls, topic("back", type_name), DEEP)
            self.create_subscription(cls, topic("there", type_name), _echo(back), DEEP)
        self.create_service(Trigger, f"{SPACE}/trigger", self._trigger)
        self.create_service(SetBool, f"{SPACE}/set_bool", self._set_bool)
        self._declare()
        self.refused = False
        self._measure = random_content.load(ACTION)
        self._action = ActionServer(
            self,
            self._measure,
            f"{SPACE}/measure",
            self._execute,
            goal_callback=self._judge,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
            callback_group=ReentrantCallbackGroup(),
        )
        # An idle executor of rclpy may take seconds to see that the process is to end.
        self.create_timer(0.3, lambda: None)

    def _declare(self) -> None:
        unit = FloatingPointRange(from_value=0.0, to_value=2.0)
        few = IntegerRange(from_value=1, to_value=9, step=1)
        self.declare_parameter(
            "speed",
            1.0,
            ParameterDescriptor(
                description="a speed, m/s",
                additional_constraints="never faster than the machine",
                floating_point_range=[unit],
            ),
        )
        self.declare_parameter("count", 3, ParameterDescriptor(integer_range=[few]))
        self.declare_parameter("fixed", "text ↑", ParameterDescriptor(read_only=True))
        self.declare_parameter("axis.steps", [1, 2, 3])
        self.declare_parameter("axis.names", ["X", "Y"])
        self.declare_parameter("axis.limits", [0.5, -0.5])
        self.declare_parameter("axis.moving", [True, False])
        self.declare_parameter("on", True)

    def _trigger(self, _request: Any, response: Any) -> Any:
        response.success, response.message = True, ANSWER
        return response

    def _set_bool(self, request: Any, response: Any) -> Any:
        response.success, response.message = not request.data, f"got {request.data}"
        return response

    def _judge(self, goal: Any) -> Any:
        """Accept the goals agreed upon, but the first one."""
        agreed = random_content.three_different(self._measure.Goal, GOAL_SEED)
        known = content(goal) in [content(one) for one in agreed[1:]]
        return GoalResponse.ACCEPT if known else GoalResponse.REJECT

    def _execute(self, handle: Any) -> Any:
        """Send feedback and the result; the third goal agreed upon lasts until it is cancelled."""
        endless = random_content.three_different(self._measure.Goal, GOAL_SEED)[2]
        feedback = random_content.samples(self._measure.Feedback, FEEDBACK_SEED)
        result = random_content.filled(self._measure.Result, random.Random(RESULT_SEED))
        if content(handle.request) == content(endless):
            while not handle.is_cancel_requested:
                time.sleep(0.01)
            handle.canceled()
            return result
        for message in feedback:
            handle.publish_feedback(message)
            time.sleep(0.005)
        # The result goes another way and would overtake the last of them.
        time.sleep(0.3)
        handle.succeed()
        return result


class Managed(LifecycleNode):
    """A managed node that publishes while it is active."""

    def __init__(self) -> None:
        super().__init__(MANAGED)
        self._chat = self.create_lifecycle_publisher(String, f"{SPACE}/managed_chat", DEEP)
        self.create_timer(0.05, self._talk)

    def _talk(self) -> None:
        self._chat.publish(String(data="active"))

    def on_configure(self, _state: LifecycleState) -> TransitionCallbackReturn:
        """Agree."""
        return TransitionCallbackReturn.SUCCESS

    def on_cleanup(self, _state: LifecycleState) -> TransitionCallbackReturn:
        """Agree."""
        return TransitionCallbackReturn.SUCCESS


def main() -> None:
    """Serve until told to end."""
    rclpy.init()
    server, managed = Server(), Managed()
    executor = MultiThreadedExecutor(3)
    executor.add_node(server)
    executor.add_node(managed)
    print("serving", flush=True)
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        executor.spin()


if __name__ == "__main__":
    main()
