"""Strategies for messages as nobody in his senses would send them, of any type that nodes hear."""

import math
from array import array
from functools import cache
from typing import Any

from hypothesis import strategies as st
from small_run import RUN_ID as OWN_RUN

from stepdiag_ros.messages.types import message_type
from stepdiag_ros.run.conclusion import BAG, BAG_CLOSED, BAG_FAILURE
from stepdiag_ros.run.supervision import (
    GETTING_READY,
    HEARD_UNTIL,
    HEARTBEAT,
    ROLE,
    RUN_ID,
    SESSION,
    TIME_SOURCE,
    WORK_LEFT,
)

MANY = 10_000
"""Elements of an array that is far longer than any that is sent."""
MANY_TRIALS = 10_000
"""``max_examples`` of the profile ``long``, which no other profile has."""
_FLOATS = (
    *(math.nan, math.inf, -math.inf, 0.0, -0.0, 1e308, -1e308, 5e-324, 1e-9, 0.01, 1.0, -1.0),
    *(9.3e18, 1e300),
)
_WORDS = (
    *("", "x", "y", "z", "xyz", "yxz", "linear", "diagonal", "forward", "backward", "x_motor"),
    *("sequencer", "recorder", "interferometer", "nonlinear", "ISO 230-2", "\0", "\x1b[2J\n"),
    *("\u202e\u2028", "../../evil", "{a: [", "9" * 5000, "x" * 10_000, "[" * 5000),
)
_ROLES = (
    *("sequencer", "cnc_bridge", "interferometer", "assembler", "solver", "recorder", "clock"),
    *("by_hand", "weather", "diagnosis", "nobody", ""),
)
_FACTS = (
    *(WORK_LEFT, HEARD_UNTIL, GETTING_READY, TIME_SOURCE, BAG, BAG_CLOSED, BAG_FAILURE),
    *("stored", "beam", "verdict", "lifecycle"),
)
_RANGES = {
    name: (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) if name[0] == "i" else (0, 2**bits - 1)
    for bits in (8, 16, 32, 64)
    for name in (f"int{bits}", f"uint{bits}")
}
_NUMPY_CODES = {
    "float64": "d", "float32": "f", "int8": "b", "uint8": "B", "int16": "h", "uint16": "H",
    "int32": "i", "uint32": "I", "int64": "q", "uint64": "Q",
}  # fmt: skip
_OTHER_NAMES = {"double": "float64", "float": "float32", "octet": "byte", "boolean": "bool"}


@cache
def messages(type_name: str) -> st.SearchStrategy[Any]:
    """Return a strategy for messages of a full type name such as ``stepdiag_ros/msg/RunState``."""
    if type_name == "diagnostic_msgs/msg/DiagnosticArray":
        return _diagnostics()
    kind = message_type(type_name)
    fields = {name: _field(name, told) for name, told in kind.get_fields_and_field_types().items()}
    return st.builds(kind, **fields)


@st.composite
def damaged(draw: st.DrawFn, valid: Any) -> Any:
    """Return a strategy for a message in which a field or two of a valid one are odd.

    The valid message is changed: give a copy.
    """
    told = valid.get_fields_and_field_types()
    names = draw(st.lists(st.sampled_from(sorted(told)), min_size=1, max_size=2, unique=True))
    for name in names:
        setattr(valid, name, draw(_field(name, told[name])))
    return valid


@cache
def _field(name: str, told: str) -> st.SearchStrategy[Any]:
    base, sequence, count = _taken_apart(told)
    base = _OTHER_NAMES.get(base, base)
    if not sequence:
        return _single(name, base)
    if base in _NUMPY_CODES:
        return _numbers(base, count)
    single = _single(name, base)
    if count is not None:
        return st.lists(single, min_size=count, max_size=count)
    return st.lists(single, max_size=4) | single.map(lambda one: [one] * 20)


def _taken_apart(told: str) -> tuple[str, bool, int | None]:
    """Return type, whether it is a sequence, and its length if that is fixed."""
    if told.startswith("sequence<"):
        return told[len("sequence<") : -1].partition(",")[0].strip(), True, None
    if told.endswith("]"):
        base, _, count = told[:-1].partition("[")
        return base, True, int(count)
    return told, False, None


def _single(name: str, base: str) -> st.SearchStrategy[Any]:
    if name == "run_id":
        return st.just(OWN_RUN) | st.just(OWN_RUN) | _texts()
    if base.startswith("string"):
        return _texts()
    if base == "bool":
        return st.booleans()
    if base == "byte":
        return st.binary(min_size=1, max_size=1)
    if base == "float64":
        return _floats()
    if base == "float32":
        return st.floats(-1e6, 1e6, width=32)
    if base in _RANGES:
        low, high = _RANGES[base]
        near = st.integers(max(low, 0), 12)
        return near | near | st.sampled_from((low, high)) | st.integers(low, high)
    return messages(base if "/msg/" in base else base.replace("/", "/msg/"))


@cache
def _floats() -> st.SearchStrategy[float]:
    return st.sampled_from(_FLOATS) | st.floats(-1.0, 1.0) | st.floats()


@cache
def _texts() -> st.SearchStrategy[str]:
    return st.sampled_from(_WORDS) | st.text(st.characters(codec="utf-8"), max_size=30)


def _numbers(base: str, count: int | None) -> st.SearchStrategy[Any]:
    single = _single("", base)
    code = _NUMPY_CODES[base]
    if count is not None:
        return st.lists(single, min_size=count, max_size=count)
    some = st.lists(single, max_size=12).map(lambda values: array(code, values))
    return some | single.map(lambda one: array(code, [one]) * MANY)


def _diagnostics() -> st.SearchStrategy[Any]:
    array_kind, status_kind, pair_kind = (
        message_type(f"diagnostic_msgs/msg/{name}")
        for name in ("DiagnosticArray", "DiagnosticStatus", "KeyValue")
    )
    known = st.fixed_dictionaries(
        {ROLE: st.sampled_from(_ROLES), SESSION: st.sampled_from("abc") | _texts()},
        optional={
            RUN_ID: st.just(OWN_RUN) | _texts(),
            **{fact: _texts() | _texts().map(lambda text: f"{OWN_RUN} {text}") for fact in _FACTS},
        },
    )
    names = st.sampled_from(_ROLES) | _texts()
    values = (known | st.dictionaries(_texts(), _texts(), max_size=3)).map(
        lambda told: [pair_kind(key=key, value=value) for key, value in told.items()]
    )
    status = st.builds(
        status_kind,
        level=st.binary(min_size=1, max_size=1),
        name=names.map(lambda name: f"{name}: {HEARTBEAT}") | _texts(),
        message=_texts(),
        hardware_id=_texts(),
        values=values,
    )
    return st.builds(
        array_kind, header=messages("std_msgs/msg/Header"), status=st.lists(status, max_size=3)
    )
