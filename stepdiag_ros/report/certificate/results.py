"""The results of a certificate: error motions, squareness, errors over the travel, the volume.

Every figure and every uncertainty is the one that the report shows. An error that is not determined
has no value: the certificate states that it is unknown.
"""

import math
from collections.abc import Iterator
from xml.etree.ElementTree import Element

from stepdiag_ros.evaluation.single_errors import (
    SingleError,
    expanded_of_curve,
    expanded_of_figure,
)
from stepdiag_ros.metrology.forward import AXES_OF
from stepdiag_ros.metrology.geometry import AXES, CURVES, SQUARENESS, moving_axis
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.solvers.result import VolumetricErrors
from stepdiag_ros.metrology.standards.axis_test import is_diagonal
from stepdiag_ros.metrology.uncertainty.budget import Budget
from stepdiag_ros.metrology.uncertainty.coverage import Expanded
from stepdiag_ros.report.certificate.xml import (
    METRE,
    RADIAN,
    element,
    no_value,
    quantity,
    real,
    reals,
    words,
)
from stepdiag_ros.report.pages.lead import NOT_ASKED, ToleranceJudgement, judge
from stepdiag_ros.report.pages.material import Material
from stepdiag_ros.words.squareness import LEAST_SQUARES_LINES, SIGN_DEFINITIONS
from stepdiag_ros.words.volumetric import DEFINITION

VOLUME_ID = "volumetricError"
"""What a statement of conformity refers to."""
ERROR = "basic_measurementError"
NOMINAL = "basic_nominalValue"
_ISO_230_FACTOR = 2.0
_UNKNOWN = "Not determined by the measured lines."


def own(name: str) -> str:
    """Return a refType of this software, which the certificate defines."""
    return f"stepdiag_{name}"


def budget_of(material: Material) -> tuple[VolumetricErrors, Budget]:
    """Return the result to rely on and its uncertainty budget.

    Raises:
        Refusal: no error is determined, or an expanded uncertainty is not known or only a lower
            bound: a certificate states complete uncertainties (ISO/IEC 17025, 7.8.4.1).
    """
    result, source = material.report.preferred(), str(material.recorded.path)
    if result is None or not any(math.isfinite(one.value) for one in material.single_errors):
        raise Refusal(
            f"{source}: the measured lines determine no error, so a certificate has no results",
            fault="undetermined",
            about="results",
            where=source,
        )
    if material.budget is None:
        raise _incomplete(source, f"This run has no budget: {material.why_not('budget')}")
    budget = material.budget.budget
    if material.lower_bound:
        unknown = ", ".join(budget.unknown_sources)
        raise _incomplete(source, f"State in the file of --instrument what is unknown: {unknown}.")
    return result, budget


def _incomplete(source: str, why: str) -> Refusal:
    return Refusal(
        f"{source}: a certificate needs the complete expanded uncertainty of each result. {why}",
        fault="undetermined",
        about="expanded uncertainty",
        where=source,
    )


def decision(material: Material) -> ToleranceJudgement | None:
    """Return the decision on the largest error vector; None where there is nothing to decide."""
    judged = judge(material)
    asked = judged.verdict != NOT_ASKED and math.isfinite(judged.value)
    return judged if asked else None


def results(material: Material) -> Element:
    """Return all results.

    Raises:
        Refusal: see ``budget_of``.
    """
    result, budget = budget_of(material)
    made = [
        *(_motions(result, budget, axis) for axis in range(len(AXES))),
        _squareness(result, budget),
        _over_the_travel(material),
        _volume(material),
        *_positioning(material),
    ]
    return element("dcc:results", *made)


def _result(name: str, meaning: str, description: str, *quantities: Element) -> Element:
    return element(
        "dcc:result",
        words("dcc:name", name),
        words("dcc:description", description),
        element("dcc:data", element("dcc:list", *quantities, ref_type=own(f"{meaning}List"))),
        ref_type=own(meaning),
    )


def name_of(error: str) -> str:
    """Return an error motion or a squareness in words, by ISO 230-1."""
    if error in AXES_OF:
        reference, other = AXES_OF[error]
        return f"Squareness error {error} of {other} to {reference}"
    of, axis = error[2], error[3]
    if of in AXES:
        kind = "Positioning" if of == axis else "Straightness"
        return f"{kind} error {error} of {axis}{'' if of == axis else f' in {of}'}"
    return f"Angular error {error} of {axis} about {AXES['ABC'.index(of)]}"


def _motions(result: VolumetricErrors, budget: Budget, axis: int) -> Element:
    """Return the error motions of an axis at its nominal positions."""
    letter = AXES[axis]
    names = [name for name in CURVES if moving_axis(name) == axis]
    return _result(
        f"Error motions of {letter} (ISO 230-1)",
        f"errorMotionsOf{letter}",
        "Motion of the tool relative to the workpiece at each nominal position, mean of all passes."
        " The first value is zero by definition, and other values may be, by the frame:"
        f" {result.frame}.",
        quantity(
            f"Nominal position of {letter}",
            NOMINAL,
            reals(map(float, result.nodes[axis]), METRE),
        ),
        *(_curve(result, budget, name) for name in names),
    )


def _curve(result: VolumetricErrors, budget: Budget, name: str) -> Element:
    meaning = f"{ERROR} {own(name)}"
    values = [float(one) for one in result.curves.get(name, ())]
    wide = expanded_of_curve(result, name, budget) if values else ()
    # A list has no place for a value that is unknown, and a certificate none without uncertainty.
    if not values or not all(map(math.isfinite, (*values, *(one.value for one in wide)))):
        return quantity(name_of(name), meaning, no_value(_UNKNOWN))
    unit = METRE if name[2] in AXES else RADIAN
    return quantity(name_of(name), meaning, reals(values, unit, wide))


def _single(name: str, meaning: str, value: float, unit: str, wide: Expanded) -> Element:
    if not math.isfinite(value) or not math.isfinite(wide.value):
        return quantity(name, meaning, no_value(_UNKNOWN))
    return quantity(name, meaning, real(value, unit, wide))


def _squareness(result: VolumetricErrors, budget: Budget) -> Element:
    figures = {figure.name: figure for figure in result.figures}
    made = []
    for name in SQUARENESS:
        figure, wide = figures.get(name), Expanded()
        if figure is not None:
            wide = expanded_of_figure(figure, budget)
        value = math.nan if figure is None else figure.value
        made.append(_single(name_of(name), f"{ERROR} {own(name)}", value, RADIAN, wide))
    return _result(
        "Squareness of the axes (ISO 230-1)",
        "squareness",
        f"Sign: {SIGN_DEFINITIONS['rotation']}. {LEAST_SQUARES_LINES}",
        *made,
    )


def _over_the_travel(material: Material) -> Element:
    return _result(
        "Errors over the travel, peak to peak",
        "peakToPeak",
        "Positioning: largest less smallest value, mean of both directions. Straightness: range off"
        " the least-squares line. Squareness: the angle times the travel.",
        *(_peak_to_peak(one) for one in material.single_errors),
    )


def _peak_to_peak(one: SingleError) -> Element:
    return _single(
        f"{name_of(one.name)} over a travel of {one.travel:g} m",
        f"{ERROR} {own(f'{one.name}_peakToPeak')}",
        one.value,
        METRE,
        Expanded(one.expanded_uncertainty, one.coverage_factor),
    )


def _volume(material: Material) -> Element:
    accuracy, name = material.accuracy, "Length of the largest error vector in the measured volume"
    meaning = f"{ERROR} {own('volumetricError')}"
    if accuracy is None or not math.isfinite(accuracy.value):
        found = [quantity(name, meaning, no_value(_UNKNOWN))]
    else:
        remark = "No more than the noise of the readings makes." if material.lead.noise else ""
        value = real(accuracy.value, METRE, material.expanded)
        referred = {} if decision(material) is None else {"id": VOLUME_ID}
        place = reals(accuracy.position, METRE, labels=AXES)
        found = [
            quantity(name, meaning, value, remark, **referred),
            quantity("Its nominal position", f"{NOMINAL} {own('volumetricErrorPosition')}", place),
        ]
    return _result("Errors in the volume", "volume", DEFINITION, *found)


def _positioning(material: Material) -> Iterator[Element]:
    """Yield the tests by ISO 230-2 whose uncertainty is completely known."""
    report = material.positioning
    if report is None or report.unknown:
        return
    for test in report.tests:
        if is_diagonal(test.kind):
            continue
        yield _result(
            f"Positioning of {test.name} along line {test.setup} ({test.standard})",
            f"iso230_2_{test.setup}",
            "Parameters of the standard; U with k = 2.",
            *(
                _single(
                    f"{name} of {test.name}",
                    own(f"iso230_2_{_ascii(name)}"),
                    value,
                    METRE,
                    Expanded(test.expanded_uncertainty[name], _ISO_230_FACTOR),
                )
                for name, value in test.parameters.items()
            ),
        )


def _ascii(name: str) -> str:
    """Return the name of a parameter without arrows and blanks."""
    return name.replace("↑", "_forward").replace("↓", "_backward").replace(" ", "_")
