"""The lead of a run in words: what decides, how large the errors are, which commands come next."""

import shlex
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path

from stepdiag_ros.bags.passes import incomplete_sentences
from stepdiag_ros.compensation.permission import held_by_any
from stepdiag_ros.evaluation.lead import RunLead
from stepdiag_ros.metrology.credibility import Misfit
from stepdiag_ros.metrology.discrepancy.findings import (
    AMBIGUOUS,
    CONSISTENT,
    DESCRIBED,
    NAMED,
    NOT_TESTABLE,
    UNEXPLAINED,
)
from stepdiag_ros.metrology.discrepancy.summary import NOT_DIAGNOSED
from stepdiag_ros.metrology.effects.several_angular_errors import EFFECT as SEVERAL_ANGULAR_ERRORS
from stepdiag_ros.metrology.plausible import ROTATIONS_KEY, Plausible
from stepdiag_ros.metrology.standards.volumetric import VolumetricAccuracy
from stepdiag_ros.metrology.target import TargetStanding
from stepdiag_ros.metrology.units import IN_MICRO, IN_MILLI
from stepdiag_ros.run.target_words import end_words
from stepdiag_ros.text.numbers import (
    OF_READINGS,
    place_in_mm,
    plain,
    with_expanded,
    with_uncertainty,
)
from stepdiag_ros.text.terminal import fitted
from stepdiag_ros.words.positioning import leading_sentences, uneven_reason

_MOST_ERRORS = 3
_MOST_MISSING = 6
_REPORT = ("report {}", "the report to hand over: HTML, PDF, JSON")
_NOT_JUDGED = (
    "report {}",
    "to hand over; --tolerance UM judges the machine by a limit",
)
_ISO_230 = ("iso230 {}", "the parameters of ISO 230-2, and the deviations at every target")
_SOLVE = ("solve {}", "the errors of the machine, with their uncertainty")
_MONITOR = ("monitor {}", "the run again, in the browser")
_TESTED = {
    CONSISTENT: "",
    NOT_TESTABLE: " No reading of this run could contradict the errors below; they are not tested.",
    NOT_DIAGNOSED: "",
    UNEXPLAINED: " Whatever causes this distorts the errors below, too.",
}
_NEED_EVEN = "Error curves and the diagnosis need evenly spaced targets."
_NOT_REPEATED = " No line was repeated: repeatability, reversal and drift were not seen."
ANGULAR_PLAN = "plan --for angular --machine MACHINE"
_IN_UNCERTAINTY = " Every ± below contains rotations of this size."
_NOT_CONTAINED = " The errors below were solved without this effect, which distorts them."


@dataclass(frozen=True)
class NextStep:
    """Something to do next.

    Attributes:
        command: to be run; empty where it is not a command that does it.
        why: what it is for, in words.
    """

    command: str
    why: str


def sentences_of(lead: RunLead) -> list[str]:
    """Return the lead in sentences, in the order in which they decide."""
    return [*deciding_sentences(lead), *size_sentences(lead)]


def deciding_sentences(lead: RunLead) -> list[str]:
    """Say what decides whether errors may be used: recording, run, verdict, fit, unknown errors."""
    said = [flaw.sentence for flaw in lead.recording]
    said += [] if lead.passes is None else incomplete_sentences(lead.passes)
    said += [] if lead.target is None else [_target(lead.target)]
    said += [] if lead.positioning is None else leading_sentences(lead.positioning)
    if lead.uneven:
        return [*said, f"{_NEED_EVEN} {uneven_reason(lead.uneven)}"]
    said.append(_verdict(lead))
    return [*said, *_misfit(lead), *_unknown(lead)]


def size_sentences(lead: RunLead) -> list[str]:
    """Say the worst place, the largest single errors, and which errors were taken as zero."""
    if lead.noise and lead.volume is not None:
        return [_noise(lead, lead.volume), *_taken_as_zero(lead)]
    said = [] if lead.volume is None else [_worst(lead, lead.volume)]
    if lead.errors:
        # An unknown error may be larger than all known ones.
        what = "Largest known single errors" if lead.unknown else "Largest single errors"
        words = "; ".join(
            f"{one.words} {with_expanded(one.value, one.expanded_uncertainty, IN_MICRO)} µm over"
            f" {one.travel * IN_MILLI:.0f} mm"
            for one in lead.errors[:_MOST_ERRORS]
        )
        said.append(f"{what}, peak to peak over the travel{_directions(lead)}: {words}.")
    return said + _taken_as_zero(lead)


def coverage_sentences(lead: RunLead) -> list[str]:
    """Say what the ± contain of which nobody stated anything; nothing without a ±.

    A run with a tracker states that in its own words.
    """
    if lead.tracked or not _has_values(lead):
        return []
    if not lead.budgeted:
        return [
            f"± (95 %): of the readings, of pitch, yaw and roll, and of"
            f" {laser_scale(lead.plausible)}. There is no uncertainty budget of this run, so that"
            " other errors of laser, air and setup are not in it."
        ]
    alone = ""
    if isfinite(lead.expanded_uncertainty_of_readings) and not lead.noise:
        size = with_uncertainty(0.0, lead.expanded_uncertainty_of_readings * IN_MICRO)[1]
        alone = f", {size} µm for the largest error"
    what = "laser, air and setup"
    if lead.material:
        what = "expansion coefficient, material temperature, laser, air and setup"
    bound = (
        f" Of {what} nothing was stated, so that U does not contain them and is a lower bound:"
        f" stepdiag report{_at_20(lead)} --instrument FILE."
    )
    return [
        f"± (95 %): U by the uncertainty budget, as in stepdiag report, or of the readings where"
        f" that is larger. Tables show '{OF_READINGS}'{alone}."
        f"{bound if lead.lower_bound else ''} {_assumed_rotations(lead)}"
    ]


def _at_20(lead: RunLead) -> str:
    """Return the option by which another command states results at 20 °C as well."""
    return " --expansion-per-K COEFFICIENT" if lead.material else ""


def laser_scale(plausible: Plausible) -> str:
    """Return the uncertainty of the laser's scale that every result contains, in words."""
    size = plain(plausible.one_setup * IN_MICRO, 2)
    return f"an assumed scale error of the laser (u = {size} µm/m in a setup)"


def _assumed_rotations(lead: RunLead) -> str:
    size = f"{lead.plausible.rotation * IN_MICRO:.3g} µrad"
    if isfinite(lead.rotation_shown):
        shown = f"{lead.rotation_shown * IN_MICRO:.3g} µrad"
        whose = "stated for the machine" if lead.rotation_stated else "assumed"
        return f"Pitch, yaw and roll: {shown}, as the readings show; {size} were {whose}."
    if lead.rotation_stated:
        return f"Pitch, yaw and roll: {size}, as stated for the machine."
    return (
        f"Assumed, because the machine file does not state '{ROTATIONS_KEY}': pitch, yaw and roll"
        f" of {size}."
    )


def next_steps(lead: RunLead) -> list[NextStep]:
    """Return what to do next, most urgent first; what comes after it only where it may."""
    if lead.bag is None:
        return []
    more_acts = lead.more_acts
    iso_230, report, judge = (
        (f"{command}{_at_20(lead)}", why) for command, why in (_ISO_230, _REPORT, _NOT_JUDGED)
    )
    named: list[tuple[str, str]] = [*_complete_first(lead), iso_230, report]
    if not lead.uneven:
        named = [
            *_complete_first(lead),
            *([] if lead.positioning is None else [iso_230]),
            *([_SOLVE] if lead.solved is None else []),
            *(_after_verdict(lead) if more_acts else []),
            *_for_unknown(lead),
            *([] if more_acts else _after_verdict(lead)),
            report if lead.volume is None or lead.tracked else judge,
            _MONITOR,
            *_compensation(lead),
        ]
    bag = shlex.quote(str(lead.bag))
    return [NextStep(command and f"stepdiag {command.format(bag)}", why) for command, why in named]


def from_here(path: Path) -> Path:
    """Return a path as seen from the present folder, if it lies below it."""
    whole = path.resolve()
    return whole.relative_to(Path.cwd()) if whole.is_relative_to(Path.cwd()) else path


def next_lines(lead: RunLead, width: int | None = None) -> list[str]:
    """Return what to do next for the terminal; nothing without a recording.

    Below the present folder the recording is named as seen from there.

    Args:
        lead: of the run.
        width: columns of the terminal; None if it is not one. A command stays on one line: where
            its reason does not fit beside it, each reason stands below.
    """
    if lead.bag is not None:
        lead = replace(lead, bag=from_here(lead.bag))
    steps = next_steps(lead)
    widest = max((len(one.command) for one in steps), default=0)
    lines = [
        f"  {one.command:<{widest}}  {one.why}" if one.command else f"  {one.why}" for one in steps
    ]
    if width is not None and max(map(len, lines), default=0) > width:
        lines = []
        for one in steps:
            lines += [f"  {one.command}"] if one.command else []
            indent = "      " if one.command else "  "
            lines += fitted(f"{indent}{one.why}", width, indent).split("\n")
    return ["Next:", *lines] if lines else []


def missing_words(lead: RunLead) -> str:
    """Return the lines of which a pass is missing."""
    missing = () if lead.passes is None else lead.passes.missing
    words = ", ".join(missing[:_MOST_MISSING])
    more = len(missing) - _MOST_MISSING
    return f"{words} and {more} lines more" if more > 0 else words or "the rest of the plan"


def _target(standing: TargetStanding) -> str:
    words = end_words(standing, standing.lines)
    return f"{words[0].upper()}{words[1:]}."


def _verdict(lead: RunLead) -> str:
    """Return the verdict of the diagnosis, and what that means for errors that were solved."""
    verdict = lead.verdict
    meaning = _TESTED.get(verdict.name, _NOT_CONTAINED) if _has_values(lead) else ""
    if meaning and verdict.contained:
        meaning = _IN_UNCERTAINTY
    if _is_left_out(lead):
        meaning = ""
    if verdict.name == CONSISTENT and not lead.repeated:
        meaning += _NOT_REPEATED
    return f"{verdict.name}: {verdict.sentence}{meaning}"


def _misfit(lead: RunLead) -> list[str]:
    """Say that errors do not explain the readings, where they do not."""
    if lead.misfit is Misfit.NONE:
        return []
    ratio = plain(lead.reduced_chi_squared, 1)
    if _is_left_out(lead):
        return [
            "The errors below were solved without this effect, which distorts them, so they do not"
            f" explain the readings (χ²/dof = {ratio}), and no ± below covers it."
        ]
    if lead.misfit is Misfit.SHOWN:
        return [
            f"These errors do not explain the readings: χ²/dof = {ratio}, and the readings repeat"
            " better than that. Another effect acts on the machine, and no ± below covers it."
        ]
    return [
        f"The readings disagree with these errors: χ²/dof = {ratio}. Either they repeat worse than"
        " the noise at each stop suggests, which every ± includes, or another effect acts, which no"
        " ± includes. Repeated passes show which."
    ]


def _is_left_out(lead: RunLead) -> bool:
    """Say whether errors do not explain the readings because of what the diagnosis has found."""
    found = lead.verdict.name in (NAMED, AMBIGUOUS, DESCRIBED)
    return found and not lead.verdict.contained and lead.misfit is Misfit.SHOWN


def _unknown(lead: RunLead) -> list[str]:
    if not lead.unknown:
        return []
    remedy = f" To determine them, measure {lead.remedy} as well." if lead.remedy else ""
    what = (
        ", ".join(lead.unknown)
        if lead.solved is not False
        else "all errors (no method could be used)"
    )
    return [f"Unknown, because the measured lines do not determine them: {what}.{remedy}"]


def _directions(lead: RunLead) -> str:
    """Say in which directions of the lines errors were measured; nothing where it is not known."""
    if len(lead.directions) == 1:
        return f", {lead.directions[0]} only (without reversal error)"
    return ", mean of both directions" if lead.directions else ""


def _noise(lead: RunLead, volume: VolumetricAccuracy) -> str:
    return (
        "No error of this machine stands out from the noise of this"
        f" measurement{_directions(lead)}. The largest error vector found,"
        f" {plain(volume.value * IN_MICRO, 3)} µm, is no larger than noise alone makes the largest"
        " of many values."
    )


def _worst(lead: RunLead, accuracy: VolumetricAccuracy) -> str:
    vector = ", ".join(
        f"{plain(value * IN_MICRO, 2)} in {letter}"
        for letter, value in zip("XYZ", accuracy.vector, strict=True)
    )
    size = with_expanded(accuracy.value, lead.expanded_uncertainty, IN_MICRO)
    which = "" if lead.budgeted else " (U of the readings)"
    if lead.budgeted and lead.lower_bound:
        which = " (U is a lower bound)"
    said = f"error vector: {vector} µm; " if isfinite(accuracy.vector[0]) else ""
    return (
        f"Largest error in the measured volume: {size} µm{which} at"
        f" {place_in_mm(accuracy.position)} ({said}errors count from the first corner of the"
        " volume)."
    )


def _has_values(lead: RunLead) -> bool:
    """Say whether any error is known that a sentence can be about."""
    return bool(lead.solved) and bool(lead.errors or lead.volume)


def _taken_as_zero(lead: RunLead) -> list[str]:
    if not lead.as_zero or not _has_values(lead):
        return []
    missing = [name for name in lead.as_zero if name not in lead.told_elsewhere]
    words = "the measured lines do not determine them"
    if not missing:
        words = "another method determines them from these lines, see its tables"
    elif lead.told_elsewhere:
        words = (
            f"another method determines {', '.join(lead.told_elsewhere)} from these lines, see its"
            f" tables; the lines do not determine {', '.join(missing)}"
        )
    return [
        f"The values are without pitch, yaw and roll of all axes, their ± contain them; {words}."
    ]


def _complete_first(lead: RunLead) -> list[tuple[str, str]]:
    return [] if lead.whole else [("", f"Measure what is missing: {missing_words(lead)}.")]


def _after_verdict(lead: RunLead) -> list[tuple[str, str]]:
    """Return what the diagnosis asks for."""
    plan = "plan --for volumetric --machine MACHINE"
    if lead.tracked:
        plan = "tracker plan --machine MACHINE --station X Y Z"
    asked: dict[str, list[tuple[str, str]]] = {
        CONSISTENT: [("diagnose {}", "the smallest effect that this run would have shown")],
        NAMED: [
            ("diagnose {} --extend MODEL.yaml", "the effect, its size, and the errors without it")
        ],
        AMBIGUOUS: [("diagnose {} --propose MORE.yaml", "what to measure to separate the causes")],
        DESCRIBED: [
            (
                "diagnose {} --extend MODEL.yaml",
                "the formula, and the errors without what it describes",
            )
        ],
        UNEXPLAINED: [("diagnose {}", "where the gap is, and what to measure to find its cause")],
        NOT_TESTABLE: [
            ("diagnose {}", "why nothing could contradict these errors"),
            (plan, "a plan whose lines test each other"),
        ],
    }
    otherwise = [("diagnose {}", "does another effect act on the machine?")]
    steps = asked.get(lead.verdict.name, otherwise)
    if lead.verdict.name == NAMED and SEVERAL_ANGULAR_ERRORS.name in lead.verdict.effects:
        return [*steps, (ANGULAR_PLAN, "a plan that shows which axes rotate")]
    return steps


def _for_unknown(lead: RunLead) -> list[tuple[str, str]]:
    if not lead.remedy:
        return []
    return [("", f"Measure {lead.remedy} as well, to determine {', '.join(lead.unknown)}.")]


def _compensation(lead: RunLead) -> list[tuple[str, str]]:
    """Propose tables only where the run is complete and nothing acts that they do not hold."""
    trusted = (
        lead.whole
        and not lead.recording
        and not lead.unknown
        and not lead.noise
        and lead.misfit is Misfit.NONE
    )
    if not lead.solved or not trusted:
        return []
    if lead.verdict.name == CONSISTENT or lead.verdict.contained:
        return [("compensate {} --for generic", "tables; --for names the control")]
    if lead.verdict.name == NAMED and held_by_any(lead.verdict):
        what = ", ".join(lead.verdict.effects)
        return [("compensate {} --for linuxcnc", f"tables; this control can hold {what}")]
    return []
