"""Every data class becomes a message and comes back the same, with every kind of message class."""

import math
from dataclasses import fields, is_dataclass, replace

import numpy as np
import pytest
from refused import refused

from stepdiag_ros.bags.types import own_types
from stepdiag_ros.embedded import registry
from stepdiag_ros.messages import conversion
from stepdiag_ros.messages.fields import set_header, to_nanoseconds
from stepdiag_ros.messages.types import new_message
from stepdiag_ros.messages.volumetric import from_volumetric_errors, to_volumetric_errors
from stepdiag_ros.metrology.geometry import CURVES
from stepdiag_ros.metrology.measurement import (
    BlockDisplacement,
    Environment,
    MeasuredLine,
    Reading,
    SettledStop,
    StopCommand,
)
from stepdiag_ros.metrology.on_the_fly.record import AxisDelay, Moved, Vibration
from stepdiag_ros.metrology.plan import Line
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.solvers.result import Figure, VolumetricErrors

TIME = 1_700_000_000_123_456_789
AIR = Environment(20.1, 101325.5, 0.51, 19.9)
LINEAR = Line("linear", "x", "", 2, "backward", (0.0, 0.12, 0.015), mirror_offset=(0.0, 0.1, -0.02))
TRACKED = Line("tracker", "north side:xyz", "", 4, "backward")
DIAGONAL = Line("step_diagonal", "npp", "YZX", 1, "forward", mirror_offset=(0.1, 0.0, 0.0))
COMMAND = StopCommand(41, 3, 2, "npp YZX", 7, "Y", (0.01, 0.02, 0.03), TIME - 5)

STOP = SettledStop(
    command=COMMAND,
    line=DIAGONAL,
    position=(0.0100001, 0.0200002, 0.0300003),
    settled=False,
    reason="drifts",
    time=TIME,
    displacement=0.123456789012345,
    raw_displacement=0.1234,
    standard_uncertainty=1.1e-8,
    standard_deviation=2.2e-7,
    readings=300,
    first_sequence=2**40,
    last_sequence=2**40 + 299,
    in_position_time=TIME + 1,
    window_start=TIME + 2,
    window_end=TIME + 3,
    environment=AIR,
)
BLOCK = BlockDisplacement(3, 2, LINEAR, TIME, 5, "X", 4, 5, 0.00577, 0.00578, 1.5e-8)
READING = Reading(TIME, 2**50 + 1, 0.25, float("nan"), 0.875, 2, AIR, 2**40)
MEASURED = MeasuredLine(
    line=LINEAR,
    line_index=9,
    attempt=2,
    setup="x @0,0.12,0.015",
    time=np.array([0.5, 1.5, 2.5]),
    end_time=TIME,
    target=np.arange(9.0).reshape(3, 3) / 7.0,
    displacement=np.array([0.0, np.nan, -0.02]),
    standard_uncertainty=np.array([1e-8, np.nan, 3e-8]),
    environment=np.arange(12.0).reshape(3, 4) / 3.0,
    overrun=0.0015,
    moved=Moved(
        (AxisDelay("X", -3e-4, 2e-6), AxisDelay("YZ", 1e-4, 3e-6)),
        Vibration(40.5, 3e-7, 2e-9),
        5e-9,
    ),
)
RESULT = VolumetricErrors(
    method="least_squares",
    nodes=(np.linspace(0, 1, 3), np.linspace(0, 2, 3), np.linspace(0, 3, 3)),
    curves={name: np.array([0.0, k / 3e6, np.nan]) for k, name in enumerate(CURVES)},
    standard_uncertainty={name: np.full(3, k / 7e8) for k, name in enumerate(CURVES)},
    figures=(Figure("C0Y", 1.3e-6, 2e-8, "rad"), Figure("tilt ppp XYZ 1", np.nan, np.nan, "rad")),
    lines=12,
    chi_squared=101.5,
    degrees_of_freedom=99,
    not_determined=("rotations of Y",),
    remarks=("one line was left out",),
)


def embedded(type_name):
    return registry.message_class(type_name)()


def through_the_wire(type_name, message):
    return own_types().decode(type_name, own_types().encode(type_name, message))


def same(first, second):
    """Compare to the last bit; unknown equals unknown."""
    if first is None or second is None:
        return first is second
    if is_dataclass(first):
        return type(first) is type(second) and all(
            same(getattr(first, field.name), getattr(second, field.name))
            for field in fields(first)
            if field.compare
        )
    if isinstance(first, dict):
        return first.keys() == second.keys() and all(same(first[k], second[k]) for k in first)
    if isinstance(first, tuple):
        return len(first) == len(second) and all(map(same, first, second))
    return np.array_equal(first, second, equal_nan=not isinstance(first, str))


CASES = {
    "InterferometerReading": (READING, conversion.to_reading, conversion.from_reading, ("laser",)),
    "StepCommand": (
        COMMAND,
        conversion.to_stop_command,
        conversion.from_stop_command,
        ("run", COMMAND.time, 0.05),
    ),
    "SettledStop": (STOP, conversion.to_settled_stop, conversion.from_settled_stop, ("run",)),
    "BlockDisplacement": (BLOCK, conversion.to_block, conversion.from_block, ("run",)),
    "MeasuredLine": (
        MEASURED,
        conversion.to_measured_line,
        conversion.from_measured_line,
        ("run",),
    ),
    "VolumetricErrors": (
        RESULT,
        to_volumetric_errors,
        from_volumetric_errors,
        ("run", TIME),
    ),
}


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("new", [embedded, own_types().new, new_message])
def test_a_data_class_survives_the_way_through_a_message(name, new):
    value, to, make, arguments = CASES[name]
    message = make(value, *arguments, new=new)
    assert same(to(message), value)
    received = through_the_wire(f"stepdiag_ros/msg/{name}", message)
    assert same(to(received), value)
    if name != "InterferometerReading":
        assert received.run_id == "run"


@pytest.mark.parametrize("name", CASES)
def test_every_field_of_a_message_is_filled(name):
    """A field that a conversion forgets stays at its default."""
    value, _, make, arguments = CASES[name]
    type_name = f"stepdiag_ros/msg/{name}"
    message, empty = make(value, *arguments, new=embedded), embedded(type_name)
    left = [
        field
        for field in message.get_fields_and_field_types()
        if str(getattr(message, field)) == str(getattr(empty, field))
    ]
    allowed = {
        "StepCommand": {"purpose"},
        "SettledStop": {"settled", "offset"},
        "BlockDisplacement": {"order"},
        "MeasuredLine": {"order"},
    }
    assert set(left) == allowed.get(name, set())


@pytest.mark.parametrize(
    "line",
    [
        LINEAR,
        DIAGONAL,
        Line("diagonal", "npp", "", 0, "forward"),
        Line("diagonal", "p0n", "", 3, "backward", (0.0, 0.25, 0.0)),
        TRACKED,
    ],
    ids=str,
)
def test_the_kind_of_a_line_survives(line):
    """The kind is in no message but MeasuredLine: the name and the order tell it."""
    block = replace(BLOCK, line=line, axis="XZ")
    assert conversion.to_block(conversion.from_block(block, "run", own_types().new)) == block
    stop = conversion.to_settled_stop(
        conversion.from_settled_stop(replace(STOP, line=line), "run", own_types().new)
    )
    assert stop.line == line
    message = conversion.from_measured_line(replace(MEASURED, line=line), "run", own_types().new)
    assert message.kind == line.kind
    assert conversion.to_measured_line(message).line == line


def test_commands_and_statuses_that_are_no_stops_are_told_apart():
    message = conversion.from_stop_command(
        COMMAND, "run", TIME, 0.05, conversion.PURPOSE_POSITION, new=embedded
    )
    assert conversion.to_stop_command(message) is None
    status = conversion.from_command_status(
        41, "run", TIME, 2, COMMAND.target, STOP.position, new=embedded
    )
    arrival = conversion.to_arrival(status)
    assert (arrival.command_id, arrival.time, arrival.position) == (41, TIME, STOP.position)
    status.status = 1
    assert conversion.to_arrival(status) is None


def test_constants_are_those_of_the_definitions():
    types = own_types()
    command, status = "stepdiag_ros/msg/StepCommand", "stepdiag_ros/msg/CommandStatus"
    assert types.constant(command, "PURPOSE_STOP") == conversion.PURPOSE_STOP
    assert types.constant(command, "PURPOSE_POSITION") == conversion.PURPOSE_POSITION
    assert types.constant(status, "STATUS_IN_POSITION") == conversion.STATUS_IN_POSITION


def test_times_before_1970_and_large_ones_survive():
    message = embedded("stepdiag_ros/msg/RunState")
    for time in (0, 1, -1, -1_500_000_000, (2**31 - 1) * 10**9 + 999_999_999):
        set_header(message, time)
        assert to_nanoseconds(message.header.stamp) == time
        assert 0 <= message.header.stamp.nanosec < 10**9


def test_lines_with_arrays_of_different_length_are_refused():
    message = conversion.from_measured_line(MEASURED, "run", new=embedded)
    message.displacement = message.displacement[:-1]
    with refused(Refusal, "mismatch", "displacement", "9"):
        conversion.to_measured_line(message)


@pytest.mark.parametrize("name", ["time", "target", "displacement", "standard_uncertainty"])
def test_lines_with_infinite_values_are_refused(name):
    message = conversion.from_measured_line(MEASURED, "run", new=embedded)
    getattr(message, name)[1] = -math.inf
    with refused(Refusal, "out_of_range", name):
        conversion.to_measured_line(message)


def test_results_with_arrays_of_different_length_are_refused():
    message = from_volumetric_errors(RESULT, "run", TIME, new=embedded)
    message.e_zy = message.e_zy[:-1]
    with refused(Refusal, "mismatch", "E_ZY"):
        to_volumetric_errors(message)


def test_an_unknown_message_is_an_import_error():
    with refused(Refusal, "unknown", "Nothing"):
        new_message("stepdiag_ros/msg/Nothing")
    # As where ROS 2 is sourced and the package is imported from its sources.
    with refused(Refusal, "not_installed", "unbuilt_msgs"):
        new_message("unbuilt_msgs/msg/Nothing")


def test_positions_are_taken_by_the_names_of_the_axes():
    from types import SimpleNamespace

    def joints(names, positions):
        return SimpleNamespace(name=names, position=positions)

    assert conversion.axis_positions(joints(["X", "Y", "Z"], [1.0, 2.0, 3.0])) == (1.0, 2.0, 3.0)
    swapped = joints(["tool", "Z", "X", "Y"], [9.0, 3.0, 1.0, 2.0])
    assert conversion.axis_positions(swapped) == (1.0, 2.0, 3.0)
    robot = joints([f"joint_{number}" for number in range(1, 7)], [0.0] * 6)
    assert conversion.axis_positions(robot) is None
    assert conversion.axis_positions(joints(["X", "Y", "Z"], [])) is None
