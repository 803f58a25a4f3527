"""Laser interferometers, as their node needs them."""

from typing import Protocol

from stepdiag_ros.metrology.measurement import Environment, Reading

Point = tuple[float, float, float]

STATUS_OK = 0
STATUS_LOW_SIGNAL = 1
STATUS_BEAM_LOST = 2
STATUS_OVERSPEED = 3
STATUS_FAULT = 4


class InterferometerDevice(Protocol):
    """An interferometer that streams readings.

    Times are ns and never decrease; a time before the last one counts as the last one.
    """

    def align(self, time_ns: int, setup: str, line: str, step: Point, start: Point) -> None:
        """Say that beam and mirror stand for a setup, and set the zero.

        Nothing happens if they stand for this setup already and its zero is not lost.

        Args:
            time_ns: now.
            setup: identity of the alignment.
            line: name of the line, x y z or a body diagonal.
            step: size of one block along X, Y, Z, m.
            start: machine coordinates of the first stop of the setup's first line, m.
        """
        ...

    def update_position(self, time_ns: int, position: Point) -> None:
        """Take the actual position of the axes (m) at a time; in order of time."""
        ...

    def update_environment(self, time_ns: int, environment: Environment) -> None:
        """Take what the weather sensors say at a time; in order of time."""
        ...

    def poll(self, time_ns: int) -> list[Reading]:
        """Return the readings since the last poll, in order."""
        ...

    def close(self) -> None:
        """Let the instrument go."""
        ...
