"""What two measurements of one machine say of it, in words."""

from dataclasses import dataclass
from math import isfinite

import numpy as np

from stepdiag_ros.compensation.identified import NO_REVERSAL, Identified
from stepdiag_ros.evaluation.changes import ChangesReport
from stepdiag_ros.metrology.agreement import (
    FAMILIES,
    OF_CURVES,
    REVERSAL,
    SAME_INSTRUMENT,
    SIGNIFICANT,
    CurveChange,
    FigureChange,
    MachineChanges,
)
from stepdiag_ros.metrology.geometry import AXES, Vector, moving_axis
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR
from stepdiag_ros.metrology.units import IN_MICRO, IN_MILLI
from stepdiag_ros.text.numbers import plain, plus_minus
from stepdiag_ros.words.diagnosis import chance

SURE = 2.0
"""Standard uncertainties up to which an error may be nothing but the measurement's own."""
BETTER, WORSE, SAME, OTHER, OPEN = "better", "worse", "same", "other", "unknown"
UNITS = {"m": ("µm", IN_MICRO), "rad": ("µrad", IN_MICRO)}
"""Unit of a value → the one it is shown in, with the factor."""
SQUARENESS_UNIT = "µm/m"
_TAKEN = {
    "positioning": ", at the end of the travel",
    "straightness": ", peak to peak",
    "angular": ", peak to peak",
}
"""What of a curve a figure is."""
_IN_FULL = 2
"""Figures of a kind that are listed one by one; of more, only the one that changed most clearly."""


@dataclass(frozen=True)
class ChangesVerdict:
    """What has become of the machine.

    Attributes:
        kind: ``better``, ``worse``, ``same`` (no significant change),
            ``other`` (changed, but the volume as a whole neither better nor worse) or ``unknown``.
        headline: a few words.
        sentence: of the volume.
    """

    kind: str
    headline: str
    sentence: str


def verdict(changes: MachineChanges) -> ChangesVerdict:
    """Return in words what has become of the machine."""
    rms = changes.rms
    if not isfinite(rms.difference):
        return _without_volume(changes)
    before = f"{plus_minus(rms.before, rms.before_uncertainty, IN_MICRO)} µm"
    after = f"{plus_minus(rms.after, rms.after_uncertainty, IN_MICRO)} µm"
    value = rms.normalised_error
    changed = changes.judgement.significant
    if not isfinite(value):
        told = f"The volume's rms error was {before} and is {after}."
        if changed:
            return ChangesVerdict(
                OTHER,
                "Changed; the change in the volume is not known",
                f"{told} Without their uncertainty this is not known to be a change."
                " Other figures have changed.",
            )
        return ChangesVerdict(
            OPEN,
            "Not known whether the machine has changed: no uncertainty",
            f"{told} Without their uncertainty this is not known to be a change.",
        )
    if not rms.changed:
        chance_has_it = (
            ""
            if abs(value) <= 1.0
            else f"; one of {changes.judgement.numbers} numbers may be beyond 1 by chance"
        )
        same = (
            f"{before} and is {after}: no significant change (E_n = {plain(value)}{chance_has_it})."
        )
        if changed:
            return ChangesVerdict(
                OTHER,
                "Changed, but the volume is neither better nor worse",
                f"The volume's rms error was {same} Other figures have changed.",
            )
        return ChangesVerdict(SAME, "No significant change", f"The volume's rms error was {same}")
    went = f"The volume's rms error went from {before} to {after}"
    limit = SURE * changes.rms_noise[1]
    if value < 0.0 and rms.after <= limit:
        least = plain(rms.before / limit, 1)
        return ChangesVerdict(
            BETTER,
            f"At least {least} times better",
            f"{went} (E_n = {plain(value)}). What is left in the curves is less than"
            f" {plain(limit * IN_MICRO, 3)} µm, twice the rms standard uncertainty of the error"
            f" vectors in the volume: at least {least} times better.",
        )
    better = value < 0.0
    factor = ratio(rms.factor if better else 1.0 / rms.factor)
    times = f"{factor} times {'better' if better else 'WORSE'}"
    return ChangesVerdict(
        BETTER if better else WORSE,
        f"The machine is {times}",
        f"{went}: {times} (E_n = {plain(value)}).",
    )


def _without_volume(changes: MachineChanges) -> ChangesVerdict:
    """Return the verdict where the error in the volume is not known."""
    told = (
        "The change in the volume is not known: not all of its error curves are determined by both"
        " measurements."
    )
    if changes.judgement.significant:
        return ChangesVerdict(OTHER, "Changed; the change in the volume is not known", told)
    if changes.joint.known:
        return ChangesVerdict(SAME, "No significant change", told)
    return ChangesVerdict(OPEN, "Not known whether the machine has changed", told)


def joint_words(changes: MachineChanges) -> str:
    """Say whether anything has changed, by all numbers together; empty if there are none."""
    judgement = changes.judgement
    if not judgement.known:
        return ""
    families = len(judgement.families)
    kinds = f" of {families} kinds" if families > 1 else ""
    bound = chance(judgement.probability)
    text = f"p {bound if bound[0] in '<>' else f'≤ {bound}'}"
    end = (
        "chance does not explain that: the machine has changed"
        if judgement.significant
        else "as chance has it"
    )
    return f"All {judgement.numbers} numbers{kinds} together: {text}; {end}."


def changed_words(changes: MachineChanges) -> list[str]:
    """Say of each kind of figures what changed, from what to what, then which curves and where."""
    said = []
    for family in FAMILIES:
        named = [one for one in changes.every_figure if one.family == family and one.changed]
        if len(named) > _IN_FULL:
            most = max(named, key=lambda one: abs(one.normalised_error))
            names = ", ".join(one.name.removeprefix(f"{family} ") for one in named)
            said.append(f"Changed: {family} {names}. Clearest: {_from_to(most)}.")
        elif named:
            said.append(f"Changed: {'; '.join(_from_to(one) for one in named)}.")
    curves = changes.changed
    if curves:
        said.append(f"Changed: the curves {', '.join(one.name for one in curves)}.")
        for unit in ("m", "rad"):
            largest = changes.most_changed(unit)
            if largest is not None and largest.changed:
                said.append(f"{largest.name} changed most: {_largest(largest)}.")
    elif changes.judgement.changed(*OF_CURVES):
        said.append("Changed: the curves together; chance may explain each by itself.")
    return said


def curve_words(changes: MachineChanges) -> list[str]:
    """Say what the nodes of all curves say together, and how many of them stand out."""
    said = []
    joint = changes.joint
    if joint.known:
        end = "" if changes.judgement.changed(*OF_CURVES) else ": by themselves, as chance has it"
        said.append(
            f"All nodes of the curves together: χ² = {plain(joint.chi_squared, 1)} for"
            f" {joint.degrees_of_freedom} independent differences, p"
            f" {_relation(joint.probability)}{end}."
        )
    errors = changes.normalised_errors
    if errors.size:
        outside = int(np.count_nonzero(np.abs(errors) > 1.0))
        said.append(
            f"|E_n| is more than 1 at {outside} of {errors.size} nodes"
            f" ({plain(100.0 * outside / errors.size, 1)} %); of an unchanged machine it is about"
            " 5 %, by chance, and nodes of one curve go together."
        )
    return said


def title(one: FigureChange) -> str:
    """Write the name of a figure, with what is taken of a curve: its end, or peak to peak."""
    if one.family == "squareness":
        return f"squareness {one.name}"
    return f"{one.name}{_TAKEN.get(one.family, '')}"


def _from_to(one: FigureChange) -> str:
    """Write what a figure was and is, with its E_n."""
    unit, scale = UNITS[one.unit]
    if one.family == "squareness":
        unit = SQUARENESS_UNIT
    name = title(one)
    if one.family == REVERSAL:
        name = f"reversal of {one.name.removeprefix(REVERSAL).strip()}"
    before = plus_minus(one.before, one.before_uncertainty, scale)
    after = plus_minus(one.after, one.after_uncertainty, scale)
    return f"{name}, from {before} to {after} {unit} (E_n = {plain(one.normalised_error)})"


def moved_words(changes: MachineChanges) -> list[str]:
    """Say where in the volume the error changed most, and where the worst place was and is."""
    moved = changes.moved
    if moved is None:
        return []
    vector = ", ".join(plain(float(one) * IN_MICRO) for one in moved.after - moved.before)
    places = [place_words(one) for one in changes.worst_places]
    worst = [
        f"{plus_minus(value, spread, IN_MICRO)} µm at {place}"
        for value, spread, place in (
            (changes.worst.before, changes.worst.before_uncertainty, places[0]),
            (changes.worst.after, changes.worst.after_uncertainty, places[1]),
        )
    ]
    length = plus_minus(moved.length, moved.length_uncertainty, IN_MICRO)
    return [
        f"Worst place: {worst[0]} before, {worst[1]} after.",
        f"The error in the volume changed most at {place_words(moved.position)}: by {length} µm"
        f" (X, Y, Z: {vector} µm)."
        + (
            ""
            if changes.judgement.changed(*OF_CURVES)
            else " The largest of many differences, as chance has it."
            if changes.judgement.significant
            else " The largest of many differences; no proof of a change."
        ),
    ]


def meaning(changes: MachineChanges) -> list[str]:
    """Say what the columns are."""
    return [
        "positioning: error at the end of the travel, not its range; straightness: range off its"
        " least-squares line (peak to peak); squareness: right-handed rotation; volume: length of"
        f" the error vectors, counted from the first corner. Frame: {changes.before.frame}.",
        f"±: {COVERAGE_FACTOR:g} standard uncertainties (95 %). E_n = (after - before) /"
        " (U_before² + U_after² - 8 cov)^½ with U = 2 u (ISO 13528) and cov by what both share:"
        " within ±1 both agree. p: probability"
        " that chance alone makes the nodes of a curve, with their correlations, differ as much.",
        "Changed: every number of the tables counts, since of many some are beyond ±1 by chance."
        " Of each kind (all nodes together, single curves, single nodes, squareness, reversal …) p"
        " is the smallest of its members times their number; a kind has changed where p times the"
        f" number of kinds is below {SIGNIFICANT:g}, less for every kind already named (Holm),"
        " and within it its members by the same rule.",
    ]


def method_words(changes: MachineChanges, instruments: tuple[str, str]) -> list[str]:
    """Say what the uncertainties hold, and what both measurements share.

    Args:
        changes: between two measurements.
        instruments: names of their instrument files; empty where none was given.
    """
    if not any(instruments):
        return [
            "U includes the scatter of the readings and plausible sizes of angular errors and of"
            " the laser's scale and alignment. Give --instrument to include the known uncertainty"
            " of laser, air, sensors and material.",
            *_shared_words(changes),
        ]
    names = dict.fromkeys(instruments)
    said = [f"U holds all known sources by the instrument file ({', '.join(names)})."]
    said += _shared_words(changes)
    if not set(changes.shared) & set(SAME_INSTRUMENT):
        said.append("If one laser with its sensors measured both, say so: --same-instrument.")
    if changes.at_least:
        said.append(
            "Not all sources are known ('stepdiag budget' names them): U is a lower bound, and the"
            " size of E_n an upper one."
        )
    return said


def _shared_words(changes: MachineChanges) -> list[str]:
    """Say what cancels in the change, since it is the same in both measurements."""
    if not changes.shared:
        return ["Both measurements are taken as independent."]
    return [
        f"The same in both, so that it cancels in the change: {', '.join(changes.shared)}. All else"
        " is taken as independent."
    ]


def ratio(factor: float) -> str:
    """Write how many times one figure is another."""
    if factor > 1000.0:
        return "> 1000"
    return plain(factor, 0 if factor >= 100.0 else 1 if factor >= 1.05 else 2)


def _relation(probability: float) -> str:
    """Write a probability with the sign in front of it."""
    text = chance(probability)
    return text if text[0] in "<>" else f"= {text}"


def _largest(one: CurveChange) -> str:
    row = one.largest
    change = plus_minus(one.difference[row], one.difference_uncertainty[row], IN_MICRO)
    value = one.normalised_error[row]
    return (
        f"{change} {UNITS[one.unit][0]} at {AXES[moving_axis(one.name)]} ="
        f" {one.positions[row] * IN_MILLI:g} mm"
        + (f" (E_n = {plain(float(value))})" if isfinite(value) else "")
    )


def place_words(position: Vector) -> str:
    """Write a place in the volume, m, shape (3,), in mm."""
    named = zip(AXES, position, strict=True)
    return ", ".join(f"{letter} {value * IN_MILLI:g}" for letter, value in named) + " mm"


def _about_the_result(one: Identified) -> list[str]:
    """Return the remarks on a result without those on how its reversal would be compensated."""
    return [
        remark
        for remark in one.remarks
        if remark != NO_REVERSAL and not remark.startswith("reversal of ")
    ]


def _machines(report: ChangesReport) -> list[str]:
    """Ask whether it is one machine, where the two have different names."""
    before, after = report.before.origin.machine, report.after.origin.machine
    if not before or not after or before == after:
        return []
    return [
        f"The machines are called '{before}' and '{after}'. If they are not the same one, nothing"
        " here is a change."
    ]


def sentences_of(report: ChangesReport) -> list[str]:
    """Return what a reader must know first: the volume, all together, what changed, where."""
    return [
        *_machines(report),
        verdict(report.changes).sentence,
        *filter(None, [joint_words(report.changes)]),
        *changed_words(report.changes),
        *curve_words(report.changes),
        *moved_words(report.changes),
    ]


def remarks_of(report: ChangesReport) -> list[str]:
    """Return what a reader must know beside, each with the measurement that it is about."""
    said = [*report.changes.remarks]
    told = [_about_the_result(one) for one in (report.before, report.after)]
    said += [f"both: {remark}" for remark in told[0] if remark in told[1]]
    said += [f"before: {remark}" for remark in told[0] if remark not in told[1]]
    said += [f"after: {remark}" for remark in told[1] if remark not in told[0]]
    return said


def uncertainty_words(report: ChangesReport) -> list[str]:
    """Return what the uncertainties hold and what was taken as independent."""
    return method_words(report.changes, report.instruments)
