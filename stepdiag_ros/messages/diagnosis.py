"""The message of a diagnosis to its data class and back; see ``conversion``."""

from collections.abc import Sequence
from typing import Any

from stepdiag_ros.messages.conversion import doubles
from stepdiag_ros.messages.fields import set_header, to_nanoseconds
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

_TYPE = "stepdiag_ros/msg/Diagnosis"
_SIZES = ("size", "unit", "meaning", "value", "standard_uncertainty", "band_low", "band_high")
_RUNNERS_UP = ("runner_up", "runner_up_gain", "runner_up_probability", "runner_up_why")


def from_diagnosis(summary: DiagnosisSummary, run_id: str, new: NewMessage = new_message) -> Any:
    """Make a ``Diagnosis`` message."""
    message = new(_TYPE)
    set_header(message, summary.time)
    message.run_id = run_id
    message.run_over = bool(summary.run_over)
    message.lines, message.lines_planned = int(summary.lines), int(summary.lines_planned)
    message.verdict, message.sentence = summary.verdict, summary.sentence
    message.findings = [_from_effect(one, new) for one in summary.findings]
    message.partial = [_from_effect(one, new) for one in summary.partial]
    message.covariance = doubles(summary.covariance)
    message.noise = float(summary.noise)
    message.noise_degrees_of_freedom = float(summary.noise_degrees_of_freedom)
    message.noise_correlation = float(summary.noise_correlation)
    message.noise_source = summary.noise_source
    for when, gap in (("before", summary.before), ("after", summary.after)):
        setattr(message, f"chi_squared_{when}", float(gap.chi_squared))
        setattr(message, f"degrees_of_freedom_{when}", int(gap.degrees_of_freedom))
        setattr(message, f"p_{when}", float(gap.p_value))
        setattr(message, f"rms_{when}", float(gap.rms))
        setattr(message, f"largest_{when}", float(gap.largest))
    message.where, message.where_after = list(summary.where), list(summary.where_after)
    message.map = [_from_share(one, new) for one in summary.map]
    message.detection_limits = [_from_limit(one, new) for one in summary.detection_limits]
    message.not_testable = list(summary.not_testable)
    message.tested = int(summary.tested)
    message.model_name, message.model = summary.model.name, summary.model.text
    message.model_sha256 = summary.model.sha256
    message.seed = int(summary.seed)
    message.software_version = summary.software_version
    message.remarks = list(summary.remarks)
    return message


def to_diagnosis(message: Any) -> DiagnosisSummary:
    """Convert a ``Diagnosis`` message.

    Raises:
        ValueError: arrays of a finding that belong together differ in length.
    """

    def gap(when: str) -> GapFigures:
        return GapFigures(
            chi_squared=float(getattr(message, f"chi_squared_{when}")),
            degrees_of_freedom=int(getattr(message, f"degrees_of_freedom_{when}")),
            p_value=float(getattr(message, f"p_{when}")),
            rms=float(getattr(message, f"rms_{when}")),
            largest=float(getattr(message, f"largest_{when}")),
        )

    return DiagnosisSummary(
        time=to_nanoseconds(message.header.stamp),
        run_over=bool(message.run_over),
        lines=int(message.lines),
        lines_planned=int(message.lines_planned),
        verdict=str(message.verdict),
        sentence=str(message.sentence),
        findings=tuple(_to_effect(one) for one in message.findings),
        partial=tuple(_to_effect(one) for one in message.partial),
        covariance=tuple(float(value) for value in message.covariance),
        noise=float(message.noise),
        noise_degrees_of_freedom=float(message.noise_degrees_of_freedom),
        noise_correlation=float(message.noise_correlation),
        noise_source=str(message.noise_source),
        before=gap("before"),
        after=gap("after"),
        where=_texts(message.where),
        where_after=_texts(message.where_after),
        map=tuple(_to_share(one) for one in message.map),
        detection_limits=tuple(_to_limit(one) for one in message.detection_limits),
        not_testable=_texts(message.not_testable),
        tested=int(message.tested),
        model=ModelSource(str(message.model_name), str(message.model), str(message.model_sha256)),
        seed=int(message.seed),
        software_version=str(message.software_version),
        remarks=_texts(message.remarks),
    )


def _texts(values: Sequence[Any]) -> tuple[str, ...]:
    return tuple(str(value) for value in values)


def _from_effect(found: FoundEffect, new: NewMessage) -> Any:
    message = new("stepdiag_ros/msg/EffectFinding")
    message.label, message.effect = found.label, found.effect
    message.setting, message.setting_value = list(found.setting), list(found.setting.values())
    message.sentence, message.source = found.sentence, found.source
    message.size = [size.name for size in found.sizes]
    message.unit = [size.unit for size in found.sizes]
    message.meaning = [size.meaning for size in found.sizes]
    message.value = doubles([size.value for size in found.sizes])
    message.standard_uncertainty = doubles([size.standard_uncertainty for size in found.sizes])
    message.band_low = doubles([size.band[0] for size in found.sizes])
    message.band_high = doubles([size.band[1] for size in found.sizes])
    message.gain, message.p_value = float(found.gain), float(found.p_value)
    message.probability = float(found.probability)
    message.ambiguous_with = list(found.ambiguous_with)
    message.runner_up = [other.label for other in found.runners_up]
    message.runner_up_gain = doubles([other.gain for other in found.runners_up])
    message.runner_up_probability = doubles([other.probability for other in found.runners_up])
    message.runner_up_why = [other.why for other in found.runners_up]
    return message


def _to_effect(message: Any) -> FoundEffect:
    ambiguous = _texts(message.ambiguous_with)
    return FoundEffect(
        label=str(message.label),
        effect=str(message.effect),
        setting={
            str(name): str(value) for name, value in _rows(message, "setting", "setting_value")
        },
        sentence=str(message.sentence),
        source=str(message.source),
        sizes=tuple(
            FoundSize(
                str(name), str(unit), str(meaning), float(value), float(spread), _band(low, high)
            )
            for name, unit, meaning, value, spread, low, high in _rows(message, *_SIZES)
        ),
        gain=float(message.gain),
        p_value=float(message.p_value),
        probability=float(message.probability),
        ambiguous_with=ambiguous,
        runners_up=tuple(
            RunnerUp(str(label), float(gain), float(chance), str(why), str(label) in ambiguous)
            for label, gain, chance, why in _rows(message, *_RUNNERS_UP)
        ),
    )


def _band(low: Any, high: Any) -> tuple[float, float]:
    return float(low), float(high)


def _rows(message: Any, *names: str) -> list[tuple[Any, ...]]:
    """Return arrays that belong together, row by row."""
    columns = [getattr(message, name) for name in names]
    if len({len(column) for column in columns}) > 1:
        raise Refusal(
            f"Diagnosis: {', '.join(names)} of '{message.label}' differ in length", fault="mismatch"
        )
    return list(zip(*columns, strict=True))


def _from_share(share: Share, new: NewMessage) -> Any:
    message = new("stepdiag_ros/msg/GapShare")
    message.split, message.part = share.split, share.part
    message.mean, message.rms = float(share.mean), float(share.rms)
    message.readings, message.p_value = int(share.readings), float(share.p_value)
    return message


def _to_share(message: Any) -> Share:
    return Share(
        split=str(message.split),
        part=str(message.part),
        mean=float(message.mean),
        rms=float(message.rms),
        readings=int(message.readings),
        p_value=float(message.p_value),
    )


def _from_limit(limit: Limit, new: NewMessage) -> Any:
    message = new("stepdiag_ros/msg/DetectionLimit")
    message.effect, message.label = limit.effect, limit.label
    message.settings = int(limit.settings)
    message.size, message.unit = limit.size, limit.unit
    message.smallest, message.largest = float(limit.smallest), float(limit.largest)
    return message


def _to_limit(message: Any) -> Limit:
    return Limit(
        effect=str(message.effect),
        label=str(message.label),
        settings=int(message.settings),
        size=str(message.size),
        unit=str(message.unit),
        smallest=float(message.smallest),
        largest=float(message.largest),
    )
