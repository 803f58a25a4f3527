"""A positioning test survives the way through its message, and wrong messages are refused."""

from dataclasses import fields

import numpy as np
import pytest
from refused import refused

from stepdiag_ros.bags.types import own_types
from stepdiag_ros.embedded import registry
from stepdiag_ros.messages.fields import to_nanoseconds
from stepdiag_ros.messages.positioning import from_positioning_test, to_positioning_test
from stepdiag_ros.messages.types import new_message
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.standards.iso230_2 import PARAMETERS, PositioningTest

TYPE = "stepdiag_ros/msg/PositioningTest"
TIME = 1_700_000_000_123_456_789
TEST = PositioningTest(
    name="npp",
    kind="diagonal",
    setup="npp diagonal",
    target=np.array([0.0, 0.1, 0.3]),
    runs=(5, 4),
    mean_forward=np.array([1.0, 2.0, 3.0]) / 7e6,
    mean_backward=np.array([1.0, -2.0, 3.0]) / 9e6,
    deviation_forward=np.array([1.0, 2.0, 3.0]) / 3e8,
    deviation_backward=np.array([np.nan, 2.0, 3.0]) / 7e8,
    parameters={name: k / 3e6 if k else float("nan") for k, name in enumerate(PARAMETERS)},
    expanded_uncertainty={name: k / 7e8 for k, name in enumerate(PARAMETERS)},
    remarks=("one run was left out",),
)


def embedded(type_name):
    return registry.message_class(type_name)()


@pytest.mark.parametrize("new", [embedded, own_types().new, new_message])
def test_a_test_survives_the_way_through_a_message(new):
    message = from_positioning_test(TEST, "run", TIME, new=new)
    received = own_types().decode(TYPE, own_types().encode(TYPE, message))
    assert (received.run_id, received.standard) == ("run", "ISO 230-6")
    assert to_nanoseconds(received.header.stamp) == TIME
    again = to_positioning_test(received)
    for field in fields(PositioningTest):
        first, second = getattr(TEST, field.name), getattr(again, field.name)
        if field.name == "parameters":
            assert np.isnan(second.pop("A"))
            first = {name: value for name, value in first.items() if name != "A"}
        if isinstance(first, np.ndarray):
            np.testing.assert_array_equal(first, second)
        else:
            assert first == second, field.name


def test_every_field_of_the_message_is_filled():
    message, empty = from_positioning_test(TEST, "run", TIME, new=embedded), embedded(TYPE)
    for field in message.get_fields_and_field_types():
        assert str(getattr(message, field)) != str(getattr(empty, field)), field


@pytest.mark.parametrize(
    ("field", "text"),
    [("s_forward", "deviation_forward"), ("value", "value")],
)
def test_arrays_of_different_length_are_refused(field, text):
    message = from_positioning_test(TEST, "run", TIME, new=embedded)
    setattr(message, field, getattr(message, field)[:-1])
    with refused(Refusal, "mismatch", "PositioningTest", "npp", text):
        to_positioning_test(message)
