"""The evaluation of Ibaraki & Hata 2010, section 4: as a JSON document.

Table 1, the setup errors and the sensitivity of the conventional formulation to them, the angular
errors with the uncertainty that eq. (29) warns of, the spread over the repeats, and the comparison
with directly measured errors.
"""

from typing import Any

from msgspec import UNSET

from stepdiag_ros import schemas
from stepdiag_ros.evaluation.experiment import Experiment
from stepdiag_ros.metrology import table_one
from stepdiag_ros.metrology.comparison import COVERAGE, DirectComparison
from stepdiag_ros.metrology.geometry import TRANSLATIONS
from stepdiag_ros.schemas.comparison import (
    Angle,
    Angles,
    AngleUncertainty,
    Comparison,
    Curve,
    Document,
    Row,
    Sensitivity,
    SetupError,
    Spread,
    Value,
)
from stepdiag_ros.schemas.parts import part_of
from stepdiag_ros.words.squareness import SIGN_DEFINITIONS, angle_of, sign


def experiment_json(experiment: Experiment) -> str:
    """Return the evaluation as JSON text."""
    return schemas.json_text(experiment_document(experiment))


def experiment_document(experiment: Experiment) -> dict[str, Any]:
    """Return the evaluation as a mapping that ``json`` can write."""
    content = Document(
        run_id=experiment.report.run_id or None,
        squareness_definitions=dict(SIGN_DEFINITIONS.items()),
        table_1=[_row(row) for row in experiment.table],
        setup_errors={
            setup.line: part_of(SetupError, setup, displacement_per_block=setup.displacement)
            for setup in experiment.setups
        },
        conventional_sensitivity={
            one.curve: Sensitivity(
                gain=one.gain, by_diagonal_m_per_rad=one.by_line, worst_m_per_rad=one.worst
            )
            for one in experiment.sensitivity
        },
        displacement_uncertainty=experiment.displacement_uncertainty,
        angle_uncertainty={
            name: AngleUncertainty(**vars(size)) for name, size in experiment.angles.items()
        },
        repeats={
            method: {name: part_of(Spread, found.spread(name)) for name in found.results[0].curves}
            for method, found in experiment.repeats.items()
        },
        comparisons=[_comparison(one) for one in experiment.comparisons],
    )
    return schemas.document("comparison", content)


def _row(row: table_one.TableOneRow) -> Row:
    return Row(
        label=row.label,
        name=row.name,
        travel=row.travel,
        measured=None if row.measured is None else part_of(Value, row.measured),
        estimated={method: part_of(Value, entry) for method, entry in row.estimated.items()},
        by_definition_rad=UNSET if row.name in TRANSLATIONS else _by_definition(row),
    )


def _by_definition(row: table_one.TableOneRow) -> dict[str, Angles]:
    made: dict[str, Angles] = {}
    for definition in SIGN_DEFINITIONS:
        factor = sign(row.name, definition)
        made[definition] = Angles(
            measured=None if row.measured is None else angle_of(row, row.measured) * factor,
            estimated={
                method: angle_of(row, entry) * factor for method, entry in row.estimated.items()
            },
        )
    return made


def _comparison(one: DirectComparison) -> Comparison:
    return Comparison(
        method=one.method,
        coverage_factor=COVERAGE,
        curves={curve.name: part_of(Curve, curve) for curve in one.curves},
        squareness={angle.name: part_of(Angle, angle) for angle in one.squareness},
        not_compared=one.not_compared,
    )
