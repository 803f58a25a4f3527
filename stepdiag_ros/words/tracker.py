"""A tracker's run in words: where it stood, the joint estimate, and ATLI Figs. 4 and 5."""

import math

import numpy as np

from stepdiag_ros.evaluation.tracker import TrackerReport
from stepdiag_ros.metrology.forward import OVER_90_DEGREES, RIGHT_HANDED
from stepdiag_ros.metrology.tracker.document_figures import FigureFive, FigureFour
from stepdiag_ros.metrology.tracker.joint import NAMES, JointEstimate
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR
from stepdiag_ros.metrology.units import IN_MICRO, IN_MILLI
from stepdiag_ros.text.numbers import UNKNOWN, plain, with_uncertainty


def figure_sentences(four: FigureFour, five: FigureFive) -> list[str]:
    """Say what the curves of ATLI Figs. 4 and 5 show, and which geometry gives them."""
    towards, away = four.towards.deviation * IN_MICRO, four.away.deviation * IN_MICRO
    half = towards[len(towards) // 2]
    located = five.located.deviation * IN_MICRO
    lowest = int(np.argmin(located))
    scatter = five.location.adjustment.uncertainty[0] * IN_MICRO
    shift = five.shift * IN_MILLI
    return [
        f"Fig. 4: squareness {np.degrees(four.gamma):.2g}° alone, tracker on the nominal line"
        f" {four.distance:.3g} m ahead of its start: the deviation is {half:.2f} µm at half the"
        f" length and {towards[-1]:.2f} µm at its end, so it grows faster than the length. With the"
        f" tracker as far behind the start it is {away[-1]:.2f} µm at the end and grows more slowly"
        " than the length.",
        f"Fig. 5: squareness {np.degrees(five.errors.gamma):.2g}°, positioning"
        f" {five.errors.scale * IN_MICRO:.3g} µm/m, tracker located from six places that the same"
        f" machine reached: it is ({shift[0]:+.2f}, {shift[1]:+.2f}, {shift[2]:+.2f}) mm away from"
        f" its estimated place. The deviation begins at {located[0]:.1f} µm, falls to"
        f" {located[lowest]:.1f} µm at {five.located.distance[lowest]:.2f} m from the tracker and"
        f" rises to {located[-1]:.1f} µm.",
        f"The residuals of these six places are {scatter:.0f} µm in size, of the order of the 13 µm"
        " that the document expected. They say nothing of the millimetres by which the place is"
        " wrong: the fit has taken these up.",
        "Calculated from the tracker's true place the same line shows its positioning error and no"
        " offset: squareness has hardly any influence along a line that runs away from the"
        " tracker.",
    ]


def with_u(value: float, expanded: float, scale: float, decimals: int) -> str:
    """Write a value with its expanded uncertainty; each may be unknown.

    Args:
        value: in SI; NaN if unknown.
        expanded: expanded uncertainty, in SI; NaN if unknown.
        scale: from SI to the unit that is shown.
        decimals: of a value without uncertainty.
    """
    if not math.isfinite(value):
        return UNKNOWN
    if not math.isfinite(expanded):
        return f"{plain(value * scale, decimals)} ± {UNKNOWN}"
    text, spread = with_uncertainty(value * scale, expanded * scale)
    return f"{text} ± {spread}"


def sentences_of(report: TrackerReport) -> list[str]:
    """Return what the reader must know, in words, each once."""
    location = report.location
    said = [*report.remarks, *(f"{text}." for text in report.left_out)]
    said += [*(f"Warning: {text}" for text in location.warnings)]
    said += location.remarks
    result = report.result
    if result is None or result.joint is None:
        said.append(
            "U of the place: 95 %, of the lengths alone; Student's factor where their uncertainty"
            " was taken from the residuals."
        )
    if result is not None:
        if result.joint is not None:
            said += _joint_sentences(result.joint)
        said.append(
            f"Squareness sign: {RIGHT_HANDED}. By the other definition ({OVER_90_DEGREES}) B0Z has"
            " the other sign, C0Y and A0Z the same."
        )
        said += result.remarks
        for name, one in result.separations.items():
            if isinstance(one, str):
                said.append(f"Line {name} alone: {one}.")
            else:
                said += one.remarks
        for test in result.located.tests:
            said += [f"Line {test.name}: {text}." for text in test.remarks]
    return list(dict.fromkeys(said))


def _joint_sentences(joint: JointEstimate) -> list[str]:
    said = [
        f"U: 95 %, including plausible error curves of the machine; {joint.machine.place}.",
        f"Frame of the tracker's position: {joint.machine.frame}.",
        "Sizes of the errors that repeat and of those that differ between passes, from the readings"
        " and from usual values: "
        + "; ".join(f"{name}: {size:.2g}" for name, size in joint.sizes.items())
        + ".",
    ]
    if not joint.machine.chain:
        said.append(
            "U is unknown, because the order of the machine's axes is not known (--chain): the"
            " levers of the angular errors depend on it."
        )
    return said + [f"Warning, joint estimate: {text}" for text in joint.warnings]


def lead_sentences(report: TrackerReport) -> list[str]:
    """Return the first sentences: whether the readings agree, and the errors they determine."""
    if report.result is None:
        return []
    said = [f"{report.verdict.name}: {report.verdict.sentence}"]
    joint = report.result.joint
    if joint is not None:
        said.append("; ".join(" ".join(pair) for pair in joint_values(joint)) + ".")
    return said


def joint_values(joint: JointEstimate) -> list[tuple[str, str]]:
    """Return name and value ± U with its unit of each scale and squareness."""
    made = []
    for index, name in enumerate(NAMES):
        unit = "µm/m" if name.startswith("scale") else "µrad"
        spread = COVERAGE_FACTOR * joint.standard_uncertainty[index]
        made.append((name, f"{with_u(joint.values[index], spread, IN_MICRO, 2)} {unit}"))
    return made
