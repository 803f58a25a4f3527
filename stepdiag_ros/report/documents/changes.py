"""Two measurements of one machine beside each other, as a program reads it."""

from dataclasses import asdict
from typing import Any

from stepdiag_ros import schemas
from stepdiag_ros.compensation.identified import Origin
from stepdiag_ros.evaluation.changes import ChangesReport
from stepdiag_ros.metrology.agreement import (
    CurveChange,
    Family,
    FigureChange,
    JointTest,
    PlaceChange,
)
from stepdiag_ros.metrology.geometry import AXES
from stepdiag_ros.words.changes import meaning, remarks_of, sentences_of, uncertainty_words, verdict


def changes_json(report: ChangesReport) -> str:
    """Return the report as JSON text; SI, ``null`` where not known (schema ``changes``)."""
    changes = report.changes
    moved = changes.moved
    content = {
        "before": _origin(report.before.origin),
        "after": _origin(report.after.origin),
        "verdict": verdict(changes).kind,
        "words": sentences_of(report),
        "meaning": meaning(changes),
        "frame": changes.before.frame,
        "chain": changes.chain or None,
        "nodes": {
            letter: nodes.tolist() for letter, nodes in zip(AXES, changes.before.nodes, strict=True)
        },
        "uncertainty": {
            "words": uncertainty_words(report),
            "instrument_before": report.instruments[0] or None,
            "instrument_after": report.instruments[1] or None,
            "shared": list(changes.shared),
            "lower_bound": changes.at_least,
        },
        "judgement": {
            "probability": schemas.number(changes.judgement.probability),
            "families": [_family(one) for one in changes.judgement.families],
        },
        "joint": _joint(changes.joint),
        "volume": {
            "rms": _figure(changes.rms),
            "worst": _figure(changes.worst),
            "worst_place_before": schemas.numbers(changes.worst_places[0]),
            "worst_place_after": schemas.numbers(changes.worst_places[1]),
            "rms_standard_uncertainty_before": schemas.number(changes.rms_noise[0]),
            "rms_standard_uncertainty_after": schemas.number(changes.rms_noise[1]),
            "moved_most": None if moved is None else _place(moved),
        },
        "figures": [_figure(one) for one in changes.figures],
        "curves": {one.name: _curve(one) for one in changes.curves},
        "remarks": remarks_of(report),
    }
    return schemas.json_text(schemas.document("changes", content))


def _origin(origin: Origin) -> dict[str, Any]:
    return {key: text or None for key, text in asdict(origin).items()}


def _figure(one: FigureChange) -> dict[str, Any]:
    return {
        "name": one.name,
        "unit": one.unit,
        "before": schemas.number(one.before),
        "before_standard_uncertainty": schemas.number(one.before_uncertainty),
        "after": schemas.number(one.after),
        "after_standard_uncertainty": schemas.number(one.after_uncertainty),
        "difference": schemas.number(one.difference),
        "difference_standard_uncertainty": schemas.number(one.difference_uncertainty),
        "normalised_error": schemas.number(one.normalised_error),
        "probability": schemas.number(one.probability),
        "changed": one.changed,
    }


def _family(one: Family) -> dict[str, Any]:
    return {
        "name": one.name,
        "members": len(one.probabilities),
        "probability": one.probability,
        "changed": one.changed,
        "named": list(one.named),
    }


def _curve(one: CurveChange) -> dict[str, Any]:
    return {
        "unit": one.unit,
        "positions": schemas.numbers(one.positions),
        "before": schemas.numbers(one.before),
        "before_standard_uncertainty": schemas.numbers(one.before_uncertainty),
        "after": schemas.numbers(one.after),
        "after_standard_uncertainty": schemas.numbers(one.after_uncertainty),
        "difference": schemas.numbers(one.difference),
        "difference_standard_uncertainty": schemas.numbers(one.difference_uncertainty),
        "normalised_error": schemas.numbers(one.normalised_error),
        "joint": _joint(one.joint),
        "changed": one.changed,
    }


def _joint(test: JointTest) -> dict[str, Any]:
    return {
        "chi_squared": schemas.number(test.chi_squared),
        "degrees_of_freedom": test.degrees_of_freedom,
        "probability": schemas.number(test.probability),
    }


def _place(moved: PlaceChange) -> dict[str, Any]:
    return {
        "position": schemas.numbers(moved.position),
        "before": schemas.numbers(moved.before),
        "after": schemas.numbers(moved.after),
        "difference_standard_uncertainty": schemas.numbers(moved.difference_uncertainty),
        "length": schemas.number(moved.length),
        "length_standard_uncertainty": schemas.number(moved.length_uncertainty),
    }
