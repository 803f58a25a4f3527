"""Messages to data classes and back: the only place where either knows of the other.

``to_*`` read any object that has the message's attributes (rclpy's, the embedded client's, a
bag's); ``from_*`` fill a new message. Times are whole nanoseconds in data classes and stamps in
messages. A run's identity is in every message and in no data class, so it is given beside it.
"""

from array import array
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from stepdiag_ros.messages.types import NewMessage, new_message
from stepdiag_ros.metrology.frames import MACHINE
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
from stepdiag_ros.metrology.plan import Line, kind_of
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.units import NANOSECONDS

_STAMPED = 2**31 * NANOSECONDS

PURPOSE_STOP = 0
PURPOSE_POSITION = 1
STATUS_IN_POSITION = 2

MOTORS = tuple(f"{axis}_motor" for axis in AXES)
"""Joints of JointState that say where the motors are; a controller's compensation lies between."""


def to_nanoseconds(stamp: Any) -> int:
    """Return a ``builtin_interfaces/Time`` as whole nanoseconds."""
    return int(stamp.sec) * NANOSECONDS + int(stamp.nanosec)


def set_stamp(stamp: Any, nanoseconds: int) -> None:
    """Write whole nanoseconds into a ``builtin_interfaces/Time``.

    Raises:
        ValueError: it is beyond the times that a stamp can hold (1901 to 2038).
    """
    if not abs(nanoseconds) < _STAMPED:
        raise ValueError(f"a time of {nanoseconds * 1e-9:g} s does not fit into a stamp")
    stamp.sec, stamp.nanosec = divmod(int(nanoseconds), NANOSECONDS)


def set_header(message: Any, time: int, frame: str = MACHINE) -> None:
    """Write time (ns) and frame into a message's header."""
    set_stamp(message.header.stamp, time)
    message.header.frame_id = frame


def _triple(values: Iterable[Any]) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z


def axis_positions(message: Any) -> tuple[float, float, float] | None:
    """Return X, Y, Z (m) of a ``sensor_msgs/JointState``; None if it is that of something else.

    The name of its topic is everybody's: a robot beside the machine may use it too.
    """
    return _joints(message, AXES)


def motor_positions(message: Any) -> tuple[float, float, float] | None:
    """Return where the motors of X, Y, Z are (m), before the controller's own compensation.

    None if the ``sensor_msgs/JointState`` does not tell.
    """
    return _joints(message, MOTORS)


def _joints(message: Any, names: Sequence[str]) -> tuple[float, float, float] | None:
    positions = dict(zip(message.name, message.position, strict=False))
    if not all(name in positions for name in names):
        return None
    return _triple(positions[name] for name in names)


def doubles(values: Any) -> "array[float]":
    """Return numbers of any shape as a float64[] field takes them, one after another."""
    # array.array is the one form that rclpy's setters, the embedded client and a bag all accept for
    # float64[]; it also makes sure that whole numbers become doubles.
    return array("d", np.asarray(values, dtype=np.float64).ravel().tolist())


def vector(values: Any) -> Vector:
    """Return the numbers of a message's field as an array."""
    # A copy: arrays of a received message may be read-only and share the receive buffer.
    return np.array(values, dtype=np.float64)


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
        environment=_environment_of(message),
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
    _set_environment(message, reading.environment)
    message.trigger = int(reading.trigger)
    return message


def to_stop_command(message: Any) -> StopCommand | None:
    """Convert a ``StepCommand`` that ends at a stop; None for one that only travels."""
    return to_command(message) if int(message.purpose) == PURPOSE_STOP else None


def to_command(message: Any) -> StopCommand:
    """Convert any ``StepCommand``; the stop of one that only travels is 0."""
    return StopCommand(
        command_id=int(message.command_id),
        line_index=int(message.line_index),
        attempt=int(message.attempt),
        setup=str(message.setup),
        stop=int(message.stop),
        axis=str(message.axis),
        target=_triple(message.target),
        time=to_nanoseconds(message.header.stamp),
    )


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
    set_header(message, time)
    message.run_id = run_id
    message.command_id = int(command.command_id)
    message.purpose = int(purpose)
    message.line_index = int(command.line_index)
    message.attempt = int(command.attempt)
    message.setup = command.setup
    message.stop = int(command.stop)
    message.axis = command.axis
    message.target = list(_triple(command.target))
    message.feed = float(feed)
    return message


def to_arrival(message: Any) -> Arrival | None:
    """Convert a ``CommandStatus`` that says in position; None for every other status."""
    if int(message.status) != STATUS_IN_POSITION:
        return None
    time, position = to_nanoseconds(message.header.stamp), _triple(message.position)
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
    message.target = list(_triple(target))
    message.position = list(_triple(position))
    message.reason = reason
    return message


# -- settled stops, blocks, lines ---------------------------------------------


def _environment_of(message: Any) -> Environment:
    return Environment(
        float(message.air_temperature),
        float(message.air_pressure),
        float(message.relative_humidity),
        float(message.material_temperature),
    )


def _set_environment(message: Any, environment: Environment) -> None:
    message.air_temperature = float(environment.air_temperature)
    message.air_pressure = float(environment.air_pressure)
    message.relative_humidity = float(environment.relative_humidity)
    message.material_temperature = float(environment.material_temperature)


def _line_of(message: Any) -> Line:
    name, order = str(message.line), str(message.order)
    return Line(
        kind=kind_of(name, order),
        name=name,
        order=order,
        repeat=int(message.repeat),
        direction=str(message.direction),
        offset=_triple(message.offset),
    )


def _set_line(message: Any, line: Line, line_index: int, attempt: int) -> None:
    message.line_index = int(line_index)
    message.attempt = int(attempt)
    message.line = line.name
    message.order = line.order
    message.repeat = int(line.repeat)
    message.direction = line.direction
    message.offset = list(_triple(line.offset))


def to_settled_stop(message: Any) -> SettledStop:
    """Convert a ``SettledStop`` message."""
    return SettledStop(
        command=StopCommand(
            command_id=int(message.command_id),
            line_index=int(message.line_index),
            attempt=int(message.attempt),
            setup=str(message.setup),
            stop=int(message.stop),
            axis=str(message.axis),
            target=_triple(message.target),
            time=to_nanoseconds(message.command_time),
        ),
        line=_line_of(message),
        position=_triple(message.position),
        settled=bool(message.settled),
        reason=str(message.reason),
        time=to_nanoseconds(message.header.stamp),
        displacement=float(message.displacement),
        raw_displacement=float(message.raw_displacement),
        standard_uncertainty=float(message.standard_uncertainty),
        standard_deviation=float(message.standard_deviation),
        readings=int(message.readings),
        first_sequence=int(message.first_sequence),
        last_sequence=int(message.last_sequence),
        in_position_time=to_nanoseconds(message.in_position_time),
        window_start=to_nanoseconds(message.window_start),
        window_end=to_nanoseconds(message.window_end),
        environment=_environment_of(message),
    )


def from_settled_stop(stop: SettledStop, run_id: str, new: NewMessage = new_message) -> Any:
    """Make a ``SettledStop`` message."""
    message = new("stepdiag_ros/msg/SettledStop")
    set_header(message, stop.time)
    message.run_id = run_id
    _set_line(message, stop.line, stop.command.line_index, stop.command.attempt)
    message.command_id = int(stop.command.command_id)
    message.setup = stop.command.setup
    message.stop = int(stop.command.stop)
    message.axis = stop.command.axis
    message.target = list(_triple(stop.command.target))
    message.position = list(_triple(stop.position))
    message.settled = bool(stop.settled)
    message.reason = stop.reason
    message.displacement = float(stop.displacement)
    message.raw_displacement = float(stop.raw_displacement)
    message.standard_uncertainty = float(stop.standard_uncertainty)
    message.standard_deviation = float(stop.standard_deviation)
    message.readings = int(stop.readings)
    message.first_sequence = int(stop.first_sequence)
    message.last_sequence = int(stop.last_sequence)
    set_stamp(message.command_time, stop.command.time)
    set_stamp(message.in_position_time, stop.in_position_time)
    set_stamp(message.window_start, stop.window_start)
    set_stamp(message.window_end, stop.window_end)
    _set_environment(message, stop.environment)
    return message


def to_block(message: Any) -> BlockDisplacement:
    """Convert a ``BlockDisplacement`` message."""
    return BlockDisplacement(
        line_index=int(message.line_index),
        attempt=int(message.attempt),
        line=_line_of(message),
        time=to_nanoseconds(message.header.stamp),
        block=int(message.block),
        axis=str(message.axis),
        from_stop=int(message.from_stop),
        to_stop=int(message.to_stop),
        nominal_displacement=float(message.nominal_displacement),
        displacement=float(message.displacement),
        standard_uncertainty=float(message.standard_uncertainty),
    )


def from_block(block: BlockDisplacement, run_id: str, new: NewMessage = new_message) -> Any:
    """Make a ``BlockDisplacement`` message."""
    message = new("stepdiag_ros/msg/BlockDisplacement")
    set_header(message, block.time)
    message.run_id = run_id
    _set_line(message, block.line, block.line_index, block.attempt)
    message.block = int(block.block)
    message.axis = block.axis
    message.from_stop = int(block.from_stop)
    message.to_stop = int(block.to_stop)
    message.nominal_displacement = float(block.nominal_displacement)
    message.displacement = float(block.displacement)
    message.standard_uncertainty = float(block.standard_uncertainty)
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
        line=_line_of(message),
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
    )


def from_measured_line(line: MeasuredLine, run_id: str, new: NewMessage = new_message) -> Any:
    """Make a ``MeasuredLine`` message."""
    message = new("stepdiag_ros/msg/MeasuredLine")
    set_header(message, line.end_time)
    message.run_id = run_id
    _set_line(message, line.line, line.line_index, line.attempt)
    message.kind = line.line.kind
    message.setup = line.setup
    message.overrun = line.overrun
    message.time = doubles(line.time)
    message.target = doubles(line.target)
    message.displacement = doubles(line.displacement)
    message.standard_uncertainty = doubles(line.standard_uncertainty)
    for column, name in enumerate(Environment._fields):
        setattr(message, name, doubles(np.asarray(line.environment)[:, column]))
    return message
