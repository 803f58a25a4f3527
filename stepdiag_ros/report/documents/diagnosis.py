"""A diagnosis as JSON: SI units, unknown is null, gaps in the order of the stops."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from stepdiag_ros import schemas
from stepdiag_ros.evaluation.diagnosis import DiagnosisReport, gap_figures
from stepdiag_ros.metrology.discrepancy.findings import Diagnosis, Finding, Pattern
from stepdiag_ros.metrology.discrepancy.held_out import HeldOut, Prediction
from stepdiag_ros.metrology.discrepancy.loose import repeated_passes
from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.model import MachineModel
from stepdiag_ros.report.documents.proposal import proposal_document


def diagnosis_json(report: DiagnosisReport) -> str:
    """Return a diagnosis as JSON text; see ``diagnosis_document``."""
    return schemas.json_text(diagnosis_document(report))


def diagnosis_document(report: DiagnosisReport) -> dict[str, Any]:
    """Return a diagnosis as a mapping that ``json`` can write."""
    diagnosis = report.diagnosis
    proof = report.held_out
    content = {
        "run_id": report.run_id or None,
        "bag": None if report.bag is None else str(report.bag),
        "sha256": report.sha256 or None,
        "further_runs": [
            {"run_id": one.run_id or None, "bag": str(one.path), "sha256": one.sha256}
            for one in report.further
        ],
        "model": {"file": report.model_source or None, **_model(report.model)},
        **verdict_document(diagnosis),
        "gap": {
            "stops": _stops(diagnosis),
            "before_m": schemas.numbers(diagnosis.residual_before),
            "after_m": schemas.numbers(diagnosis.residual_after),
        },
        "proposal": proposal_document(
            report.proposal, "" if report.proposal_path is None else str(report.proposal_path)
        ),
        "held_out": None if proof is None else _proof(proof),
        "rounds": [verdict_document(one) for one in report.rounds],
        "extended_model": None if report.extended is None else _model(report.extended),
        "extended_model_file": None if report.extended_path is None else str(report.extended_path),
        "remarks": list(report.remarks),
    }
    return schemas.document("diagnosis", content)


def verdict_document(diagnosis: Diagnosis) -> dict[str, Any]:
    """Return the verdict and what it rests on, without the gap at each stop."""
    return {
        "verdict": diagnosis.verdict,
        "sentence": diagnosis.sentence,
        "findings": [_finding(one) for one in diagnosis.findings],
        "partial": [_finding(one) for one in diagnosis.partial],
        "tested": diagnosis.tested,
        "noise": {
            "standard_deviation_m": schemas.number(diagnosis.noise),
            "degrees_of_freedom": schemas.number(diagnosis.noise_degrees_of_freedom),
            "correlation": schemas.number(diagnosis.noise_correlation),
            "source": diagnosis.noise_source,
            "zero_scatter_m": _zero_scatter(diagnosis),
        },
        "before": _fit(
            diagnosis.chi_squared_before,
            diagnosis.degrees_of_freedom_before,
            diagnosis.lack_of_fit_p_before,
            diagnosis.residual_before,
        ),
        "after": _fit(
            diagnosis.chi_squared_after,
            diagnosis.degrees_of_freedom_after,
            diagnosis.lack_of_fit_p_after,
            diagnosis.residual_after,
        ),
        "where": list(diagnosis.where),
        "where_after": list(diagnosis.where_after),
        "patterns": [_pattern(look) for look in diagnosis.patterns],
        "patterns_after": [_pattern(look) for look in diagnosis.patterns_after],
        "map": [
            {
                "split": share.split,
                "part": share.part,
                "mean_m": schemas.number(share.mean),
                "rms_m": schemas.number(share.rms),
                "readings": share.readings,
                "p_value": schemas.number(share.p_value),
            }
            for share in diagnosis.map
        ],
        "detection_limits": _mapping(diagnosis.detection_limits),
        "not_testable": dict(diagnosis.not_testable),
    }


def _model(model: MachineModel) -> dict[str, Any]:
    """Return the model as its file has it, but null where that says ``unknown``."""
    mapping = model.to_mapping()
    for made, effect in zip(mapping["effects"], model.effects, strict=True):
        made["standard_uncertainty"] = {
            name: schemas.number(value) for name, value in effect.standard_uncertainty.items()
        }
    return mapping


def _finding(finding: Finding) -> dict[str, Any]:
    candidate = finding.candidate
    return {
        "label": finding.label,
        "effect": candidate.effect.name,
        "setting": {name: _plain(value) for name, value in candidate.setting.items()},
        "sentence": candidate.effect.sentence,
        "source": candidate.effect.source,
        "sizes": [
            {
                "name": size.name,
                "unit": size.unit,
                "meaning": size.meaning,
                "value": schemas.number(finding.sizes[size.name]),
                "standard_uncertainty": schemas.number(finding.standard_uncertainty[size.name]),
                "band_95": schemas.numbers(np.array(finding.band[size.name])),
            }
            for size in candidate.effect.sizes
        ],
        "covariance": [schemas.numbers(row) for row in finding.covariance],
        "over_travel": None
        if finding.over_travel is None
        else dict(
            zip(
                ("value", "standard_uncertainty", "expanded_uncertainty"),
                finding.over_travel,
                strict=True,
            )
        ),
        "gain": schemas.number(finding.gain),
        "p_value": schemas.number(finding.p_value),
        "probability": schemas.number(finding.probability),
        "group": list(finding.group),
        "ambiguous_with": list(finding.ambiguous),
        "runners_up": [
            {
                "label": other.label,
                "gain": schemas.number(other.gain),
                "probability": schemas.number(other.probability),
                "ruled_out": not other.ambiguous,
                "why": other.why,
            }
            for other in finding.runners_up
        ],
    }


def _pattern(look: Pattern) -> dict[str, Any]:
    return {
        "words": look.words,
        "place": look.place,
        "lines": list(look.lines),
        "with_what": look.with_what,
        "rms_m": schemas.number(look.rms),
        "share": schemas.number(look.share),
        "gain": schemas.number(look.gain),
        "p_value": schemas.number(look.p_value),
        "or_else": list(look.or_else),
    }


def _fit(squares: float, freedom: int, chance: float, gap: Vector) -> dict[str, Any]:
    rms, largest = gap_figures(gap)
    return {
        "chi_squared": schemas.number(squares),
        "degrees_of_freedom": freedom,
        "p_value": schemas.number(chance),
        "rms_m": schemas.number(rms),
        "largest_m": schemas.number(largest),
    }


def _proof(proof: HeldOut) -> dict[str, Any]:
    def part(one: Prediction) -> dict[str, Any]:
        return {
            **_fit(one.chi_squared, one.degrees_of_freedom, one.p_value, one.residual),
            "residual_m": schemas.numbers(one.residual),
        }

    return {
        "split": proof.split,
        "readings": proof.readings,
        "effects": list(proof.labels),
        "named_by_the_other_readings_alone": proof.independent,
        "verdict_of_the_other_readings": proof.training_verdict,
        "before": part(proof.before),
        "after": part(proof.after),
        "gain": {
            "chi_squared": schemas.number(proof.gain),
            "p_value": schemas.number(proof.gain_p_value),
        },
    }


def _stops(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    stops = diagnosis.stops
    return [
        {
            "run": stops.lines[index].run,
            "line": stops.lines[index].name,
            "order": stops.lines[index].order or None,
            "repeat": stops.lines[index].repeat,
            "direction": stops.lines[index].direction,
            "stop": int(stop),
            "time_s": schemas.number(float(time)),
        }
        for index, stop, time in zip(stops.pass_index, stops.number, stops.time, strict=True)
    ]


def _plain(value: Any) -> Any:
    item = getattr(value, "item", None)
    return item() if callable(item) else value


def _mapping(values: Mapping[str, float]) -> dict[str, float | None]:
    return {name: schemas.number(value) for name, value in values.items()}


def _zero_scatter(diagnosis: Diagnosis) -> float | None:
    known = math.isfinite(diagnosis.noise) and repeated_passes(diagnosis.stops)
    return diagnosis.loose.zero if known else None
