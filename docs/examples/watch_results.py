#!/usr/bin/env python3
"""Tells in words how a measurement goes and what its largest errors are.

An example for nodes of your own that use results. On a ROS 2 that stepdiag_ros was built in:

    python3 watch_results.py
    python3 watch_results.py --ros-args -r __ns:=/cell   # of the nodes in the namespace /cell

The same on a machine without ROS 2, with stepdiag_ros installed by pip.
"""

import math
from contextlib import suppress

import stepdiag_ros.client  # noqa: F401 - where no ROS 2 is sourced, this makes rclpy importable

# isort: split
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from stepdiag_ros.msg import Diagnosis, RunState, VolumetricErrors

# What holds until something newer is said. A subscriber that asks for less, for example the default
# of ROS 2, would miss what was said before it came, until that is repeated.
LATCHED = QoSProfile(
    depth=20,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
STATES = {
    RunState.STATE_IDLE: "idle",
    RunState.STATE_RUNNING: "measures",
    RunState.STATE_PAUSED: "paused",
    RunState.STATE_WAITING_FOR_SETUP: "waits for laser and mirror to be set up",
    RunState.STATE_FINISHED: "finished",
    RunState.STATE_ABORTED: "aborted",
    RunState.STATE_FAULT: "stopped by a fault",
}


class WatchResults(Node):
    """Prints the state of the run, the largest errors of each method, and the diagnosis."""

    def __init__(self) -> None:
        super().__init__("watch_results")
        self._said: dict[str, str] = {}
        # Relative names: the node finds the measurement of its own namespace.
        self.create_subscription(RunState, "run/state", self._on_state, LATCHED)
        self.create_subscription(
            VolumetricErrors, "result/volumetric_errors", self._on_errors, LATCHED
        )
        self.create_subscription(Diagnosis, "result/diagnosis", self._on_diagnosis, LATCHED)

    def _on_state(self, state: RunState) -> None:
        text = f"run {state.run_id or '-'}: {STATES.get(state.state, 'in an unknown state')}"
        if state.state == RunState.STATE_RUNNING:
            text += f" {state.line}"
        elif state.text:
            text += f": {state.text}"
        self._say("state", text)

    def _on_errors(self, errors: VolumetricErrors) -> None:
        # Each method speaks for itself; a line gives the first result, each further line a better.
        worst = [
            largest(errors, "displacement", "xyz", 1e6, "µm"),
            largest(errors, "rotation", "abc", 1e6, "µrad"),
        ]
        text = f"{errors.method}, {errors.lines} lines: {'; '.join(filter(None, worst))}"
        # The names alone; the reason stands behind the colon.
        unknown = [reason.partition(":")[0] for reason in errors.not_determined]
        if unknown:
            text += f"; not wholly determined: {', '.join(unknown)}"
        self._say(errors.method, text)

    def _on_diagnosis(self, diagnosis: Diagnosis) -> None:
        until_now = "" if diagnosis.run_over else f", after {diagnosis.lines} lines"
        self._say("diagnosis", f"diagnosis{until_now}: {diagnosis.verdict}: {diagnosis.sentence}")

    def _say(self, about: str, text: str) -> None:
        """Print what is news: states and results are repeated for late listeners."""
        if self._said.get(about) != text:
            self._said[about] = text
            print(text, flush=True)


def largest(errors: VolumetricErrors, kind: str, directions: str, factor: float, unit: str) -> str:
    """Return the largest error of one kind in words; empty if the method has none of that kind.

    Args:
        errors: of one method.
        kind: displacement or rotation.
        directions: first letters of the errors of this kind.
        factor: from m or rad to the unit.
        unit: shown.
    """
    found = []
    estimated = False
    for axis in "xyz":
        places = getattr(errors, axis)
        for direction in directions:
            curve = getattr(errors, f"e_{direction}{axis}")  # empty: the method does not tell it
            uncertainty = getattr(errors, f"u_e_{direction}{axis}")
            name = f"E_{direction}{axis}".upper()
            estimated = estimated or len(curve) > 0
            found += [
                (abs(value), name, value, uncertainty[i], axis.upper(), places[i])
                for i, value in enumerate(curve)
                # Zero at the first place by definition. NaN: these lines cannot tell it.
                if i > 0 and math.isfinite(value)
            ]
    if not found:
        return f"no {kind} is known" if estimated else ""
    _, name, value, u, axis, place = max(found)
    known = f"standard uncertainty {u * factor:.2f} {unit}" if math.isfinite(u) else "u unknown"
    where = f"at {axis} = {place * 1e3:.1f} mm"
    return f"largest {kind} {name} = {value * factor:.2f} {unit} {where} ({known})"


def main() -> None:
    """Run the node until Ctrl-C."""
    rclpy.init()
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(WatchResults())


if __name__ == "__main__":
    main()
