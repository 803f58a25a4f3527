"""The message of a diagnosis to its data class and back; see ``conversion``."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

from stepdiag_ros.messages.fields import Carried, Field, Header, Messages, doubles
from stepdiag_ros.messages.types import NewMessage, new_message
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


class _Rows:
    """Arrays of a finding that belong together: a row of them for each value.

    Args:
        columns: name of each array → kind of its cells.
        row: makes the row of a value.
        value: makes the value of a row.
    """

    def __init__(
        self,
        columns: dict[str, type],
        row: Callable[[Any], tuple[Any, ...]],
        value: Callable[..., Any],
    ) -> None:
        self._columns, self._row, self._value = columns, row, value

    def read(self, message: Any) -> Any:
        columns = [getattr(message, name) for name in self._columns]
        if len({len(column) for column in columns}) > 1:
            raise Refusal(
                f"Diagnosis: {', '.join(self._columns)} of '{message.label}' differ in length",
                fault="mismatch",
            )
        kinds = self._columns.values()
        return tuple(
            self._value(*(kind(cell) for kind, cell in zip(kinds, row, strict=True)))
            for row in zip(*columns, strict=True)
        )

    def write(self, message: Any, value: Iterable[Any]) -> None:
        rows = [self._row(one) for one in value]
        for number, (name, kind) in enumerate(self._columns.items()):
            column = [row[number] for row in rows]
            setattr(message, name, doubles(column) if kind is float else column)


class _Setting(_Rows):
    """Where and how an effect acts: name → value."""

    def __init__(self) -> None:
        super().__init__({"setting": str, "setting_value": str}, tuple, lambda *pair: pair)

    def read(self, message: Any) -> dict[str, str]:
        return dict(super().read(message))

    def write(self, message: Any, value: Any) -> None:
        super().write(message, value.items())


class _RunnersUp(_Rows):
    """What lost; which of these are not ruled out stands in ``ambiguous_with``."""

    def __init__(self) -> None:
        super().__init__(
            {
                "runner_up": str,
                "runner_up_gain": float,
                "runner_up_probability": float,
                "runner_up_why": str,
            },
            lambda one: (one.label, one.gain, one.probability, one.why),
            RunnerUp,
        )

    def read(self, message: Any) -> tuple[RunnerUp, ...]:
        open_still = list(message.ambiguous_with)
        return tuple(
            replace(one, ambiguous=one.label in open_still) for one in super().read(message)
        )


_SIZES = _Rows(
    {
        "size": str,
        "unit": str,
        "meaning": str,
        "value": float,
        "standard_uncertainty": float,
        "band_low": float,
        "band_high": float,
    },
    lambda one: (one.name, one.unit, one.meaning, one.value, one.standard_uncertainty, *one.band),
    lambda name, unit, meaning, value, spread, *band: FoundSize(
        name, unit, meaning, value, spread, (band[0], band[1])
    ),
)
_EFFECT = Carried(FoundEffect, setting=_Setting(), sizes=_SIZES, runners_up=_RunnersUp())
_SUMMARY = Carried(
    DiagnosisSummary,
    time=Header(),
    findings=Messages("findings", "stepdiag_ros/msg/EffectFinding", _EFFECT),
    partial=Messages("partial", "stepdiag_ros/msg/EffectFinding", _EFFECT),
    before=Carried(GapFigures, "_before", p_value=Field("p_before", float)),
    after=Carried(GapFigures, "_after", p_value=Field("p_after", float)),
    map=Messages("map", "stepdiag_ros/msg/GapShare", Carried(Share)),
    detection_limits=Messages(
        "detection_limits", "stepdiag_ros/msg/DetectionLimit", Carried(Limit)
    ),
    model=Carried(
        ModelSource,
        name=Field("model_name", str),
        text=Field("model", str),
        sha256=Field("model_sha256", str),
    ),
)


def from_diagnosis(summary: DiagnosisSummary, run_id: str, new: NewMessage = new_message) -> Any:
    """Make a ``Diagnosis`` message."""
    message = new("stepdiag_ros/msg/Diagnosis")
    _SUMMARY.write(message, summary, new)
    message.run_id = run_id
    return message


def to_diagnosis(message: Any) -> DiagnosisSummary:
    """Convert a ``Diagnosis`` message.

    Raises:
        ValueError: arrays of a finding that belong together differ in length.
    """
    made: DiagnosisSummary = _SUMMARY.read(message)
    return made
