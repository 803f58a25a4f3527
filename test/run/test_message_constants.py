"""Numbers that are written down twice, in msg/ and where no ROS is known, are the same."""

import re
from pathlib import Path

import pytest

from stepdiag_ros.devices import interferometer
from stepdiag_ros.messages import conversion
from stepdiag_ros.metrology.target import TargetState
from stepdiag_ros.metrology.window import STATUS_WORDS
from stepdiag_ros.run.sequence import Answer, Purpose, State

MESSAGES = Path(__file__).parents[2] / "msg"


def constants(message, prefix):
    text = (MESSAGES / f"{message}.msg").read_text()
    found = re.findall(rf"^uint8 {prefix}_(\w+)=(\d+)", text, re.MULTILINE)
    return {name: int(number) for name, number in found}


@pytest.mark.parametrize(
    ("enumeration", "message", "prefix"),
    [
        (State, "RunState", "STATE"),
        (Purpose, "StepCommand", "PURPOSE"),
        (Answer, "CommandStatus", "STATUS"),
        (TargetState, "TargetStanding", "STATE"),
    ],
)
def test_enumerations_are_those_of_the_messages(enumeration, message, prefix):
    assert {member.name: member.value for member in enumeration} == constants(message, prefix)


def test_the_status_of_a_reading_is_that_of_the_message():
    told = constants("InterferometerReading", "STATUS")
    assert told["OK"] == interferometer.STATUS_OK == 0
    assert set(STATUS_WORDS) == set(told.values()) - {0}
    assert {
        name: number
        for name, number in vars(interferometer).items()
        if name.startswith("STATUS_") and told.get(name.removeprefix("STATUS_")) != number
    } == {}
    assert constants("CommandStatus", "STATUS")["IN_POSITION"] == conversion.STATUS_IN_POSITION
