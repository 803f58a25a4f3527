"""Tests of positioning as a JSON document."""

from typing import Any

from stepdiag_ros import schemas
from stepdiag_ros.evaluation.positioning import PositioningReport
from stepdiag_ros.metrology.standards.iso230_2 import PositioningTest


def entry_of(test: PositioningTest, report: PositioningReport) -> dict[str, Any]:
    """Return the entry of one test."""
    published = None
    if report.published is not None:
        published = {
            name: {
                "value": value,
                "agrees": report.published.agrees(name, test.parameters[name]),
            }
            for name, value in report.published.values.items()
        }
    return {
        "standard": test.standard,
        "name": test.name,
        "kind": test.kind,
        "setup": test.setup,
        "runs": {"forward": test.runs[0], "backward": test.runs[1]},
        "target": schemas.numbers(test.target),
        "mean_forward": schemas.numbers(test.mean_forward),
        "mean_backward": schemas.numbers(test.mean_backward),
        "reversal": schemas.numbers(test.reversal),
        "s_forward": schemas.numbers(test.deviation_forward),
        "s_backward": schemas.numbers(test.deviation_backward),
        "repeatability": schemas.numbers(test.repeatability),
        "parameters": {
            name: {
                "value": schemas.number(value),
                "expanded_uncertainty": schemas.number(test.expanded_uncertainty[name]),
            }
            for name, value in test.parameters.items()
        },
        "published": published,
        "equals_recorded": report.equals_recorded.get(test.setup),
        "remarks": list(test.remarks),
    }


def positioning_json(report: PositioningReport) -> str:
    """Return the report as JSON text; SI, ``null`` where not known."""
    content = {
        "source": report.source,
        "run_id": report.run_id or None,
        "coverage_factor": 2.0,
        "tests": [entry_of(test, report) for test in report.tests],
        "diagonals": [
            {
                "place": group.place,
                "E_d": schemas.number(group.systematic_deviation),
                "B_d": schemas.number(group.reversal_value),
                "expanded_uncertainty_E_d": schemas.number(group.systematic_uncertainty),
                "expanded_uncertainty_B_d": schemas.number(group.reversal_uncertainty),
                "tests": [
                    {"label": label, "diagonal": test.name, "setup": test.setup}
                    for label, test in zip(group.labels, group.tests, strict=True)
                ],
                "remarks": list(group.remarks),
            }
            for group in report.groups
        ],
        "uncertainty_not_known": list(report.unknown),
        "warnings": list(report.warnings),
    }
    return schemas.json_text(schemas.document("iso230", content))
