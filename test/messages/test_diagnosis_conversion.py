"""A diagnosis survives the way through its message, and wrong messages are refused."""

from dataclasses import fields, replace

import numpy as np
import pytest
from refused import refused

from stepdiag_ros.bags.types import own_types
from stepdiag_ros.embedded import registry
from stepdiag_ros.messages import conversion
from stepdiag_ros.messages.diagnosis import from_diagnosis, to_diagnosis
from stepdiag_ros.metrology.discrepancy.findings import RunnerUp, Share
from stepdiag_ros.metrology.discrepancy.summary import (
    DiagnosisSummary,
    FoundEffect,
    FoundSize,
    GapFigures,
    Limit,
    ModelSource,
)
from stepdiag_ros.metrology.refusal import Refusal

TYPE = "stepdiag_ros/msg/Diagnosis"
TIME = 1_700_000_000_123_456_789
NAN = float("nan")
FOUND = FoundEffect(
    label="pitch-periodic error of Z, period 0.02 m",
    effect="pitch-periodic error",
    setting={"axis": "Z", "period_m": repr(0.1 + 0.2)},
    sentence="the screw's pitch varies",
    source="ISO 230-2",
    sizes=(
        FoundSize("sine", "m", "of the wave", 1e-6 / 3, 1e-8 / 3, (0.9e-6 / 3, 1.1e-6 / 3)),
        FoundSize("cosine", "m", "of the wave", -1e-6 / 7, NAN, (NAN, NAN)),
    ),
    gain=100.0 / 3,
    p_value=1e-5 / 3,
    probability=0.9 + 1e-16,
    ambiguous_with=("scale of Z",),
    runners_up=(
        RunnerUp("scale of Z", 33.0, 0.1, "closes less", ambiguous=True),
        RunnerUp("backlash of Z", 3.0, 1e-9, "closes next to nothing"),
    ),
)
SUMMARY = DiagnosisSummary(
    time=TIME,
    run_over=True,
    lines=6,
    lines_planned=28,
    verdict="AMBIGUOUS",
    sentence="The gap closes.",
    findings=(FOUND,),
    partial=(replace(FOUND, label="another", ambiguous_with=(), runners_up=()),),
    covariance=(1e-16 / 3, NAN, NAN, 1e-16 / 7),
    noise=1e-7 / 3,
    noise_degrees_of_freedom=100.5,
    noise_correlation=0.1,
    noise_source="differences of repeats",
    before=GapFigures(123.4, 100, 1e-9, 2e-7 / 3, 5e-7 / 3),
    after=GapFigures(98.7, 98, 0.3, 1e-7 / 3, 3e-7 / 3),
    where=("the Z moves of ppp",),
    where_after=("nowhere",),
    map=(
        Share("line", "ppp", 1e-8 / 3, 2e-8 / 3, 26, 0.001),
        Share("line", "x", 0.1, 0.2, 13, 0.5),
    ),
    detection_limits=(Limit("backlash", "backlash of X", 3, "lost_motion", "m", 1e-8, 2e-8),),
    not_testable=("scale of X: the curve E_XX, free in the model, would do the same.",),
    tested=1234,
    model=ModelSource("mill", "name: mill\n", "ab" * 32),
    seed=2**31 - 1,
    software_version="0.1.0",
    remarks=("one remark",),
)


def embedded(type_name):
    return registry.message_class(type_name)()


@pytest.mark.parametrize("new", [embedded, own_types().new, conversion.new_message])
def test_a_diagnosis_survives_the_way_through_a_message(new):
    message = from_diagnosis(SUMMARY, "run", new=new)
    received = own_types().decode(TYPE, own_types().encode(TYPE, message))
    assert received.run_id == "run"
    again = to_diagnosis(received)
    # NaN is not equal to itself, but written alike.
    assert repr(again) == repr(SUMMARY)
    assert again.words == "AMBIGUOUS (6 of 28 passes): The gap closes."


def test_every_field_of_the_messages_is_filled():
    message = from_diagnosis(SUMMARY, "run", new=embedded)
    parts = (message.findings[0], message.map[0], message.detection_limits[0])
    for one in (message, *parts):
        empty = type(one)()
        for field in one.get_fields_and_field_types():
            assert str(getattr(one, field)) != str(getattr(empty, field)), field


def test_every_value_of_the_summary_is_in_the_message():
    """Whatever is not written comes back as it was in an empty message."""
    empty = to_diagnosis(embedded(TYPE))
    again = to_diagnosis(from_diagnosis(SUMMARY, "run", new=embedded))
    for field in fields(DiagnosisSummary):
        assert repr(getattr(again, field.name)) != repr(getattr(empty, field.name)), field.name


@pytest.mark.parametrize(
    ("array", "names"),
    [
        ("band_low", ["size", "unit", "band_low", "band_high"]),
        ("setting_value", ["setting", "setting_value"]),
        ("runner_up_why", ["runner_up", "runner_up_why"]),
    ],
)
def test_arrays_of_different_length_are_refused(array, names):
    message = from_diagnosis(SUMMARY, "run", new=embedded)
    found = message.findings[0]
    setattr(found, array, getattr(found, array)[:-1])
    with refused(Refusal, "mismatch", *names) as caught:
        to_diagnosis(message)
    assert FOUND.label in str(caught.value)


def test_unknown_numbers_are_nan_on_the_wire():
    message = from_diagnosis(SUMMARY, "run", new=embedded)
    assert np.isnan(message.findings[0].standard_uncertainty[1])
    assert np.isnan(message.findings[0].band_high[1])
