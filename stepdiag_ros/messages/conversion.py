"""Messages to data classes and back: the only place where either knows of the other.

``to_*`` read any object that has the message's attributes (rclpy's, the embedded client's, a
bag's); ``from_*`` fill a new message. Times are whole nanoseconds in data classes and stamps in
messages. A run's identity is in every message and in no data class, so it is given beside it.
"""

from collections.abc import Iterable, Sequence
from math import nan
from typing import Any

import numpy as np

from stepdiag_ros.messages.fields import (
    Carried,
    Header,
    Stamp,
    defaults_of,
    doubles,
    set_header,
    to_nanoseconds,
    triple,
)
from stepdiag_ros.messages.types import NewMessage, new_message
from stepdiag_ros.metrology.geometry import AXES, Vector
from stepdiag_ros.metrology.measurement import (
    Arrival,
    BlockDisplacement,
    Environment,
    MeasuredLine,
    Reading,
    SettledStop,
    StopCommand,
)
from stepdiag_ros.metrology.on_the_fly.record import AxisDelay, Moved, Vibration
from stepdiag_ros.metrology.plan import Line, kind_of
from stepdiag_ros.metrology.refusal import Refusal

PURPOSE_STOP = 0
PURPOSE_POSITION = 1
STATUS_IN_POSITION = 2

MOTORS = tuple(f"{axis}_motor" for axis in AXES)
"""Joints of JointState that say where the motors are; a controller's compensation lies between."""


def axis_positions(message: Any) -> tuple[float, float, float] | None:
    """Return X, Y, Z (m) of a ``sensor_msgs/JointState``; None if it is that of something else.

    The name of its topic is everybody's: a robot beside the machine may use it too.
    """
    return _joints(message, AXES)


def motor_positions(message: Any) -> tuple[float, float, float] | None:
    """Return where the motors of X, Y, Z are (m), before the controller's own compensation.

    None if the ``sensor_msgs/JointState`` lacks it.
    """
    return _joints(message, MOTORS)


def _joints(message: Any, names: Sequence[str]) -> tuple[float, float, float] | None:
    positions = dict(zip(message.name, message.position, strict=False))
    if not all(name in positions for name in names):
        return None
    return triple(positions[name] for name in names)


def vector(values: Any) -> Vector:
    """Return the numbers of a message's field as an array."""
    # A copy: arrays of a received message may be read-only and share the receive buffer.
    return np.array(values, dtype=np.float64)


class _LineFields:
    """Which pass a message is about; its kind follows from its name and order."""

    def read(self, message: Any) -> Line:
        name, order = str(message.line), str(message.order)
        return Line(
            kind=kind_of(name, order),
            name=name,
            order=order,
            repeat=int(message.repeat),
            direction=str(message.direction),
            offset=triple(message.offset),
            # Bags from before this was recorded do not tell it.
            mirror_offset=triple(getattr(message, "mirror_offset", (0.0, 0.0, 0.0))),
        )

    def write(self, message: Any, value: Line) -> None:
        message.line = value.name
        message.order = value.order
        message.repeat = int(value.repeat)
        message.direction = value.direction
        message.offset = list(triple(value.offset))
        message.mirror_offset = list(triple(value.mirror_offset))


class _EnvironmentFields:
    """Air and material, spelled out: thousands of readings a second go through here."""

    def read(self, message: Any) -> Environment:
        return Environment(
            float(message.air_temperature),
            float(message.air_pressure),
            float(message.relative_humidity),
            float(message.material_temperature),
        )

    def write(self, message: Any, value: Environment) -> None:
        message.air_temperature = float(value.air_temperature)
        message.air_pressure = float(value.air_pressure)
        message.relative_humidity = float(value.relative_humidity)
        message.material_temperature = float(value.material_temperature)


class _MovedFields:
    """Delays and vibration of a line on the fly; bags from before they were recorded lack them."""

    def read(self, message: Any) -> Moved | None:
        """Return them; None of a line that was measured at stops.

        Raises:
            ValueError: not every delay has an axis and a standard uncertainty.
        """
        axes = list(getattr(message, "moved_axes", ()))
        if not axes:
            return None
        delays, spread = vector(message.delay), vector(message.delay_standard_uncertainty)
        if not len(axes) == len(delays) == len(spread):
            raise Refusal(
                f"MeasuredLine of line {message.line_index}: {len(axes)} moved_axes,"
                f" {len(delays)} values of delay, {len(spread)} of delay_standard_uncertainty",
                fault="mismatch",
            )
        return Moved(
            delays=tuple(
                AxisDelay(str(axis), float(delay), float(u))
                for axis, delay, u in zip(axes, delays, spread, strict=True)
            ),
            vibration=Vibration(
                float(message.vibration_frequency),
                float(message.vibration_amplitude),
                float(message.vibration_standard_uncertainty),
            ),
            common=float(message.common_standard_uncertainty),
        )

    def write(self, message: Any, value: Moved | None) -> None:
        delays = () if value is None else value.delays
        message.moved_axes = [one.axis for one in delays]
        message.delay = doubles([one.delay for one in delays])
        message.delay_standard_uncertainty = doubles([one.standard_uncertainty for one in delays])
        message.common_standard_uncertainty = nan if value is None else value.common
        vibration = Vibration() if value is None else value.vibration
        message.vibration_frequency = vibration.frequency
        message.vibration_amplitude = vibration.amplitude
        message.vibration_standard_uncertainty = vibration.standard_uncertainty


_LINE, _ENVIRONMENT, _MOVED = _LineFields(), _EnvironmentFields(), _MovedFields()
_COMMAND = Carried(StopCommand, time=Header())
_STOP = Carried(
    SettledStop,
    time=Header(),
    command=Carried(StopCommand, time=Stamp("command_time")),
    line=_LINE,
    environment=_ENVIRONMENT,
)
_BLOCK = Carried(BlockDisplacement, time=Header(), line=_LINE)

ADDED_LATER = frozenset(
    name
    for kind in (Reading, StopCommand, SettledStop, BlockDisplacement, MeasuredLine)
    for name in defaults_of(kind)
) | {
    "mirror_offset",
    "budgeted",
    "upper_bound",
    "outcome",
    "standing",
    "until",
    "moved_axes",
    "delay",
    "delay_standard_uncertainty",
    "common_standard_uncertainty",
    "vibration_frequency",
    "vibration_amplitude",
    "vibration_standard_uncertainty",
}
"""Fields that older bags of this schema version lack: those with a default in their data class."""

# -- readings, commands, arrivals ---------------------------------------------


def to_reading(message: Any) -> Reading:
    """Convert an ``InterferometerReading``."""
    return Reading(
        time=to_nanoseconds(message.header.stamp),
        sequence=int(message.sequence),
        raw_displacement=float(message.raw_displacement),
        compensated_displacement=float(message.compensated_displacement),
        signal_strength=float(message.signal_strength),
        status=int(message.status),
        environment=_ENVIRONMENT.read(message),
        # Bags from before this was recorded do not tell it.
        trigger=int(getattr(message, "trigger", 0)),
    )


def from_reading(
    reading: Reading, frame: str, new: NewMessage = new_message, message: Any = None
) -> Any:
    """Make an ``InterferometerReading``.

    Args:
        reading: the reading.
        frame: of the instrument, for the header.
        new: makes the empty message.
        message: an ``InterferometerReading`` to fill instead of a new one, which is faster.
    """
    if message is None:
        message = new("stepdiag_ros/msg/InterferometerReading")
    set_header(message, reading.time, frame)
    message.sequence = int(reading.sequence)
    message.raw_displacement = float(reading.raw_displacement)
    message.compensated_displacement = float(reading.compensated_displacement)
    message.signal_strength = float(reading.signal_strength)
    message.status = int(reading.status)
    _ENVIRONMENT.write(message, reading.environment)
    message.trigger = int(reading.trigger)
    return message


def to_stop_command(message: Any) -> StopCommand | None:
    """Convert a ``StepCommand`` that ends at a stop; None for one that only travels."""
    return to_command(message) if int(message.purpose) == PURPOSE_STOP else None


def to_command(message: Any) -> StopCommand:
    """Convert any ``StepCommand``; the stop of one that only travels is 0."""
    made: StopCommand = _COMMAND.read(message)
    return made


def from_stop_command(
    command: StopCommand,
    run_id: str,
    time: int,
    feed: float,
    purpose: int = PURPOSE_STOP,
    new: NewMessage = new_message,
) -> Any:
    """Make a ``StepCommand``; time in ns, feed in m/s, purpose one of its PURPOSE_*."""
    message = new("stepdiag_ros/msg/StepCommand")
    _COMMAND.write(message, command)
    set_header(message, time)
    message.run_id = run_id
    message.purpose = int(purpose)
    message.feed = float(feed)
    return message


def to_arrival(message: Any) -> Arrival | None:
    """Convert a ``CommandStatus`` that says in position; None for every other status."""
    if int(message.status) != STATUS_IN_POSITION:
        return None
    time, position = to_nanoseconds(message.header.stamp), triple(message.position)
    return Arrival(int(message.command_id), time, position)


def from_command_status(
    command_id: int,
    run_id: str,
    time: int,
    status: int,
    target: Iterable[float],
    position: Iterable[float],
    reason: str = "",
    new: NewMessage = new_message,
) -> Any:
    """Make a ``CommandStatus``; time in ns, target and position in m, status one of STATUS_*."""
    message = new("stepdiag_ros/msg/CommandStatus")
    set_header(message, time)
    message.run_id = run_id
    message.command_id = int(command_id)
    message.status = int(status)
    message.target = list(triple(target))
    message.position = list(triple(position))
    message.reason = reason
    return message


# -- settled stops, blocks, lines ---------------------------------------------


def to_settled_stop(message: Any) -> SettledStop:
    """Convert a ``SettledStop`` message."""
    made: SettledStop = _STOP.read(message)
    return made


def from_settled_stop(stop: SettledStop, run_id: str, new: NewMessage = new_message) -> Any:
    """Make a ``SettledStop`` message."""
    message = new("stepdiag_ros/msg/SettledStop")
    _STOP.write(message, stop)
    message.run_id = run_id
    return message


def to_block(message: Any) -> BlockDisplacement:
    """Convert a ``BlockDisplacement`` message."""
    made: BlockDisplacement = _BLOCK.read(message)
    return made


def from_block(block: BlockDisplacement, run_id: str, new: NewMessage = new_message) -> Any:
    """Make a ``BlockDisplacement`` message."""
    message = new("stepdiag_ros/msg/BlockDisplacement")
    _BLOCK.write(message, block)
    message.run_id = run_id
    return message


def to_measured_line(message: Any) -> MeasuredLine:
    """Convert a ``MeasuredLine`` message.

    Raises:
        ValueError: the arrays of the message do not have one value (three for targets) a stop.
    """
    stops = len(message.time)
    columns = {
        name: vector(getattr(message, name))
        for name in ("time", "displacement", "standard_uncertainty", *Environment._fields)
    }
    target = vector(message.target)
    lengths = {name: len(values) for name, values in columns.items()}
    lengths["target"] = len(target) // 3 if len(target) % 3 == 0 else -1
    wrong = [name for name, length in lengths.items() if length != stops]
    if wrong:
        raise Refusal(
            f"MeasuredLine of line {message.line_index}: '{wrong[0]}' does not have one value "
            f"for each of the {stops} stops",
            fault="mismatch",
        )
    return MeasuredLine(
        line=_LINE.read(message),
        line_index=int(message.line_index),
        attempt=int(message.attempt),
        setup=str(message.setup),
        time=columns["time"],
        end_time=to_nanoseconds(message.header.stamp),
        target=target.reshape(stops, 3),
        displacement=columns["displacement"],
        standard_uncertainty=columns["standard_uncertainty"],
        environment=np.column_stack([columns[name] for name in Environment._fields]),
        # Bags from before this was recorded do not tell it.
        overrun=float(getattr(message, "overrun", 0.0)),
        moved=_MOVED.read(message),
    )


def from_measured_line(line: MeasuredLine, run_id: str, new: NewMessage = new_message) -> Any:
    """Make a ``MeasuredLine`` message."""
    message = new("stepdiag_ros/msg/MeasuredLine")
    set_header(message, line.end_time)
    message.run_id = run_id
    _LINE.write(message, line.line)
    message.line_index, message.attempt = int(line.line_index), int(line.attempt)
    message.kind = line.line.kind
    message.setup = line.setup
    message.overrun = line.overrun
    _MOVED.write(message, line.moved)
    message.time = doubles(line.time)
    message.target = doubles(line.target)
    message.displacement = doubles(line.displacement)
    message.standard_uncertainty = doubles(line.standard_uncertainty)
    for column, name in enumerate(Environment._fields):
        setattr(message, name, doubles(np.asarray(line.environment)[:, column]))
    return message
