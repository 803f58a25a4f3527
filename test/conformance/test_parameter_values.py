"""Values on the command line: what an unquoted word is, a number, a truth value or a text."""

from __future__ import annotations

import math
from typing import Any

import pytest
from refused import refused

VALUES: dict[str, Any] = {
    "1": 1,
    "+3": 3,
    "-3": -3,
    "010": 8,
    "0x1F": 31,
    "0": 0,
    "9223372036854775807": 2**63 - 1,
    "9223372036854775808": 2.0**63,
    "1.0": 1.0,
    "1e3": 1000.0,
    "1E-3": 0.001,
    ".5": 0.5,
    "5.": 5.0,
    "09": 9.0,
    "0x1p3": 8.0,
    "-0.0": -0.0,
    ".inf": math.inf,
    "-.INF": -math.inf,
    "infinity": math.inf,
    "1e999": "1e999",
    "1e-320": "1e-320",
    "0x": "0x",
    "0b101": "0b101",
    "0o17": "0o17",
    "1e": "1e",
    "1_000": "1_000",
    "1:30": "1:30",
    "1,5": "1,5",
    "12abc": "12abc",
    "2026-01-02": "2026-01-02",
    "y": True,
    "On": True,
    "TRUE": True,
    "n": False,
    "off": False,
    "tRUE": "tRUE",
    "null": "null",
    "~": "~",
    "a b": "a b",
    "'on'": "on",
    '"3"': "3",
    "''": "",
    "!!str 3": "3",
    "!!float 3": 3,
    "3 # a remark": 3,
    "[1, 2]": [1, 2],
    "[1e3, 2.0]": [1000.0, 2.0],
    "[y, off]": [True, False],
    "[a, '1']": ["a", "1"],
}


def test_a_value_is_what_ros_takes_it_for(ros: Any) -> None:
    ros.shutdown()
    words = [word for i, text in enumerate(VALUES) for word in ("-p", f"p{i}:={text}")]
    ros.init(args=["program", "--ros-args", *words, "-p", "no_number:=.NaN"])
    node = ros.create_node("taker", automatically_declare_parameters_from_overrides=True)
    for i, (text, expected) in enumerate(VALUES.items()):
        value = node.get_parameter(f"p{i}").value
        value = value if isinstance(value, bool | int | float | str) else list(value)
        assert value == expected and type(value) is type(expected), text
        assert not isinstance(value, float) or math.copysign(1, value) == math.copysign(1, expected)
    assert math.isnan(node.get_parameter("no_number").value)
    node.destroy_node()


@pytest.mark.parametrize("text", ["", "[1, 2.0]", "{a: 1}", "-", "[1"])
def test_what_is_no_value_is_refused(ros: Any, text: str) -> None:
    ros.shutdown()
    with refused(Exception, None, "p:="):
        ros.init(args=["program", "--ros-args", "-p", f"p:={text}"])
