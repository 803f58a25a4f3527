"""A measurement in short: worst place, largest single errors, what was taken as zero."""

import shlex
from collections.abc import Sequence
from math import isfinite

import numpy as np

from stepdiag_ros.metrology.credibility import Misfit, is_noise, misfit
from stepdiag_ros.metrology.geometry import ROTATIONS
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.solvers.result import VolumetricErrors
from stepdiag_ros.metrology.standards.volumetric import VolumetricAccuracy, of_result
from stepdiag_ros.report.content import Report
from stepdiag_ros.report.numbers import COVERAGE_FACTOR, MICRO, plain, with_expanded
from stepdiag_ros.report.single_errors import SingleError, single_errors

_MOST_ERRORS = 3
_NEXT = (
    ("report {}", "the whole measurement as one page to hand over"),
    ("diagnose {}", "whether anything acts that these errors do not contain"),
    ("monitor {}", "the run as it was, in a browser"),
    ("compensate {} --for generic", "if nothing else acts: tables; --for names the control"),
)


def short_sentences(
    report: Report,
    accuracy: VolumetricAccuracy | None,
    expanded_uncertainty: float,
    errors: Sequence[SingleError],
) -> list[str]:
    """Say the worst place, the largest single errors, and which errors were taken as zero.

    Args:
        report: of the run.
        accuracy: of the method to rely on; None if nothing was solved.
        expanded_uncertainty: of its longest error vector (95 %), m; NaN if not known.
        errors: by the same method.
    """
    preferred = report.preferred()
    if accuracy is not None and isfinite(accuracy.value) and preferred and is_noise(preferred):
        return [_noise(accuracy.value, report.measurement), *_taken_as_zero(report)]
    said = []
    if accuracy is not None and isfinite(accuracy.value):
        said.append(_worst(accuracy, expanded_uncertainty))
    known = [one for one in errors if isfinite(one.value)]
    largest = sorted(known, key=lambda one: one.value, reverse=True)[:_MOST_ERRORS]
    if largest:
        words = "; ".join(
            f"{one.words} {with_expanded(one.value, one.expanded_uncertainty, MICRO)} µm over"
            f" {one.travel * 1e3:.0f} mm"
            for one in largest
        )
        said.append(
            "The largest single errors, peak to peak over the"
            f" travel{_directions(report.measurement)}: {words}."
        )
    return said + _taken_as_zero(report)


def _directions(measurement: Measurement | None) -> str:
    """Say in which directions of the lines errors were measured; nothing where it is not known."""
    found = set() if measurement is None else {one.line.direction for one in measurement.lines}
    if len(found) == 1:
        return f", {found.pop()} alone (no reversal in them)"
    return ", mean of both directions" if found else ""


def _noise(largest: float, measurement: Measurement | None) -> str:
    return (
        "No error of this machine stands out from the noise of this"
        f" measurement{_directions(measurement)}: the largest error vector found,"
        f" {plain(largest * MICRO, 3)} µm, is no more than noise makes."
    )


def _worst(accuracy: VolumetricAccuracy, expanded_uncertainty: float) -> str:
    place = ", ".join(
        f"{letter} {plain(value * 1e3, 1)}"
        for letter, value in zip("XYZ", accuracy.position, strict=True)
    )
    vector = ", ".join(
        f"{plain(value * MICRO, 2)} in {letter}"
        for letter, value in zip("XYZ", accuracy.vector, strict=True)
    )
    size = with_expanded(accuracy.value, expanded_uncertainty, MICRO)
    return (
        f"At its worst place in the measured box, {place} mm, the tool stands {size} µm from where"
        f" it should ({vector} µm, counted from the box's first corner)."
    )


def _taken_as_zero(report: Report) -> list[str]:
    preferred = report.preferred()
    if preferred is None or any(name in preferred.curves for name in ROTATIONS):
        return []
    told = {
        name
        for result in report.results
        for name in ROTATIONS
        if name in result.curves and np.all(np.isfinite(result.curves[name]))
    }
    words = "the measured lines cannot tell them"
    if len(told) == len(ROTATIONS):
        words = "another method tells them from these lines, see its tables"
    elif told:
        missing = ", ".join(name for name in ROTATIONS if name not in told)
        others = ", ".join(name for name in ROTATIONS if name in told)
        words = (
            f"another method tells {others} from these lines, see its tables; the lines cannot"
            f" tell {missing}"
        )
    return [f"Taken as zero in these figures: pitch, yaw and roll of all axes; {words}."]


def in_short(report: Report) -> list[str]:
    """Say in short what was found, with the uncertainty of the readings; nothing where unsolved.

    Args:
        report: of the run.
    """
    preferred = report.preferred()
    if preferred is None:
        return []
    accuracy = None
    if report.chain or not any(name in preferred.curves for name in ROTATIONS):
        accuracy = of_result(preferred, report.chain)
    spread = float("nan") if accuracy is None else accuracy.standard_uncertainty
    errors = single_errors(preferred)
    said = short_sentences(report, accuracy, COVERAGE_FACTOR * spread, errors)
    return misfit_sentences(preferred, report.measurement) + said


def misfit_sentences(result: VolumetricErrors, measurement: Measurement | None) -> list[str]:
    """Say that errors do not explain the readings, where they do not.

    Args:
        result: the errors.
        measurement: that they were solved from; None if it is not at hand.
    """
    found = misfit(result, measurement)
    if found is Misfit.NONE:
        return []
    ratio = plain(result.chi_squared / result.degrees_of_freedom, 1)
    if found is Misfit.SHOWN:
        return [
            f"These errors do not explain the readings (χ²/dof = {ratio}, and the readings repeat"
            " better than that): something acts that they do not contain, and no ± covers it."
        ]
    return [
        f"The readings disagree with these errors (χ²/dof = {ratio}): either they repeat worse than"
        " their windows tell, which every ± has in it, or something acts that these errors do not"
        " contain, which none has; passes that are repeated would tell."
    ]


def next_commands(report: Report) -> list[str]:
    """Return what to run next on the bag, a line each; nothing without a bag.

    Args:
        report: of the run.
    """
    if report.bag is None or not report.results:
        return []
    bag = shlex.quote(str(report.bag))
    lines = [(f"  stepdiag {command.format(bag)}", why) for command, why in _NEXT]
    width = max(len(command) for command, _ in lines)
    return ["Next:", *(f"{command:<{width}}  {why}" for command, why in lines)]
