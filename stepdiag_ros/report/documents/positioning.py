"""Tests of positioning as a JSON document."""

from stepdiag_ros import schemas
from stepdiag_ros.evaluation.positioning import PositioningReport
from stepdiag_ros.metrology.standards.iso230_2 import PositioningTest
from stepdiag_ros.schemas.iso230 import Diagonals, Document, Label, Parameter, Published, Runs, Test
from stepdiag_ros.schemas.parts import part_of


def entry_of(test: PositioningTest, report: PositioningReport) -> Test:
    """Return the entry of one test."""
    published = None
    if report.published is not None:
        published = {
            name: Published(
                value=value, agrees=report.published.agrees(name, test.parameters[name])
            )
            for name, value in report.published.values.items()
        }
    return part_of(
        Test,
        test,
        runs=Runs(forward=test.runs[0], backward=test.runs[1]),
        s_forward=test.deviation_forward,
        s_backward=test.deviation_backward,
        parameters={
            name: Parameter(value=value, expanded_uncertainty=test.expanded_uncertainty[name])
            for name, value in test.parameters.items()
        },
        published=published,
        equals_recorded=report.equals_recorded.get(test.setup),
    )


def positioning_json(report: PositioningReport) -> str:
    """Return the report as JSON text; SI, ``null`` where not known."""
    content = Document(
        source=report.source,
        run_id=report.run_id or None,
        coverage_factor=2.0,
        tests=[entry_of(test, report) for test in report.tests],
        diagonals=[
            Diagonals(
                place=group.place,
                E_d=group.systematic_deviation,
                B_d=group.reversal_value,
                expanded_uncertainty_E_d=group.systematic_uncertainty,
                expanded_uncertainty_B_d=group.reversal_uncertainty,
                tests=[
                    Label(label=label, diagonal=test.name, setup=test.setup)
                    for label, test in zip(group.labels, group.tests, strict=True)
                ],
                remarks=group.remarks,
            )
            for group in report.groups
        ],
        uncertainty_not_known=report.unknown,
        warnings=report.warnings,
    )
    return schemas.json_text(schemas.document("iso230", content))
