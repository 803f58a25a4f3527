"""A diagnosis as a JSON document; gaps are in the order of the stops."""

import math
from typing import Any

from stepdiag_ros import schemas
from stepdiag_ros.evaluation.diagnosis import DiagnosisReport, rms_and_largest
from stepdiag_ros.metrology.discrepancy import findings, held_out
from stepdiag_ros.metrology.discrepancy.findings import Diagnosis
from stepdiag_ros.metrology.discrepancy.loose import repeated_passes
from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.model import MachineModel
from stepdiag_ros.report.documents.proposal import proposal_part
from stepdiag_ros.schemas.diagnosis import (
    Dependence,
    Description,
    Document,
    FiledModel,
    Finding,
    Fit,
    FurtherRun,
    Gain,
    Gap,
    Model,
    Noise,
    OverTravel,
    Pattern,
    Prediction,
    Proof,
    RunnerUp,
    Share,
    Size,
    Stop,
    Verdict,
)
from stepdiag_ros.schemas.parts import part_of


def diagnosis_json(report: DiagnosisReport) -> str:
    """Return a diagnosis as JSON text; see ``diagnosis_document``."""
    return schemas.json_text(diagnosis_document(report))


def diagnosis_document(report: DiagnosisReport) -> dict[str, Any]:
    """Return a diagnosis as a mapping that ``json`` can write."""
    content = Document(
        run_id=report.run_id or None,
        bag=None if report.bag is None else str(report.bag),
        sha256=report.sha256 or None,
        further_runs=[
            FurtherRun(run_id=one.run_id or None, bag=str(one.path), sha256=one.sha256)
            for one in report.further
        ],
        model=FiledModel(file=report.model_source or None, **_model(report.model)),
        **vars(_verdict(report.diagnosis)),
        gap=Gap(
            stops=_stops(report.diagnosis),
            before_m=report.diagnosis.residual_before.tolist(),
            after_m=report.diagnosis.residual_after.tolist(),
        ),
        proposal=proposal_part(
            report.proposal, "" if report.proposal_path is None else str(report.proposal_path)
        ),
        held_out=None if report.held_out is None else _proof(report.held_out),
        rounds=[_verdict(one) for one in report.rounds],
        extended_model=None if report.extended is None else Model(**_model(report.extended)),
        extended_model_file=None if report.extended_path is None else str(report.extended_path),
        remarks=report.remarks,
    )
    return schemas.document("diagnosis", content)


def _verdict(diagnosis: Diagnosis) -> Verdict:
    return part_of(
        Verdict,
        diagnosis,
        findings=[_finding(one) for one in diagnosis.findings],
        partial=[_finding(one) for one in diagnosis.partial],
        description=_description(diagnosis.description),
        noise=Noise(
            standard_deviation_m=diagnosis.noise,
            degrees_of_freedom=diagnosis.noise_degrees_of_freedom,
            correlation=diagnosis.noise_correlation,
            source=diagnosis.noise_source,
            zero_scatter_m=_zero_scatter(diagnosis),
        ),
        before=_fit(
            diagnosis.chi_squared_before,
            diagnosis.degrees_of_freedom_before,
            diagnosis.lack_of_fit_p_before,
            diagnosis.residual_before,
        ),
        after=_fit(
            diagnosis.chi_squared_after,
            diagnosis.degrees_of_freedom_after,
            diagnosis.lack_of_fit_p_after,
            diagnosis.residual_after,
        ),
        patterns=[part_of(Pattern, look, rms_m=look.rms) for look in diagnosis.patterns],
        patterns_after=[
            part_of(Pattern, look, rms_m=look.rms) for look in diagnosis.patterns_after
        ],
        map=[part_of(Share, share, mean_m=share.mean, rms_m=share.rms) for share in diagnosis.map],
    )


def _description(described: findings.Description | None) -> Description | None:
    if described is None:
        return None
    dependences = [
        part_of(Dependence, one, rivals=[findings.dependence_words(*rival) for rival in one.rivals])
        for one in described.dependences
    ]
    return Description(
        dependences=dependences,
        nearest=described.nearest or None,
        nearest_share=described.nearest_share,
    )


def _model(model: MachineModel) -> dict[str, Any]:
    """Return the model as its file has it, but null where that says ``unknown``."""
    mapping = model.to_mapping()
    for made, effect in zip(mapping["effects"], model.effects, strict=True):
        made["standard_uncertainty"] = effect.standard_uncertainty
    return mapping


def _finding(finding: findings.Finding) -> Finding:
    candidate = finding.candidate
    return part_of(
        Finding,
        finding,
        effect=candidate.effect.name,
        setting=candidate.setting,
        sentence=candidate.effect.sentence,
        source=candidate.effect.source,
        sizes=[
            part_of(
                Size,
                size,
                value=finding.sizes[size.name],
                standard_uncertainty=finding.standard_uncertainty[size.name],
                band_95=finding.band[size.name],
            )
            for size in candidate.effect.sizes
        ],
        over_travel=None if finding.over_travel is None else _over_travel(*finding.over_travel),
        ambiguous_with=finding.ambiguous,
        runners_up=[
            part_of(RunnerUp, other, ruled_out=not other.ambiguous) for other in finding.runners_up
        ],
    )


def _over_travel(value: float, standard: float, expanded: float) -> OverTravel:
    return OverTravel(value=value, standard_uncertainty=standard, expanded_uncertainty=expanded)


def _fit(squares: float, freedom: int, chance: float, gap: Vector) -> Fit:
    rms, largest = rms_and_largest(gap)
    return Fit(
        chi_squared=squares,
        degrees_of_freedom=freedom,
        p_value=chance,
        rms_m=rms,
        largest_m=largest,
    )


def _proof(proof: held_out.HeldOut) -> Proof:
    return Proof(
        split=proof.split,
        readings=proof.readings,
        effects=proof.labels,
        named_by_the_other_readings_alone=proof.independent,
        verdict_of_the_other_readings=proof.training_verdict,
        before=_prediction(proof.before),
        after=_prediction(proof.after),
        gain=Gain(chi_squared=proof.gain, p_value=proof.gain_p_value),
    )


def _prediction(one: held_out.Prediction) -> Prediction:
    fit = _fit(one.chi_squared, one.degrees_of_freedom, one.p_value, one.residual)
    return Prediction(**vars(fit), residual_m=one.residual.tolist())


def _stops(diagnosis: Diagnosis) -> list[Stop]:
    stops = diagnosis.stops
    return [
        Stop(
            run=stops.lines[index].run,
            line=stops.lines[index].name,
            order=stops.lines[index].order or None,
            repeat=stops.lines[index].repeat,
            direction=stops.lines[index].direction,
            stop=stop,
            time_s=time,
        )
        for index, stop, time in zip(stops.pass_index, stops.number, stops.time, strict=True)
    ]


def _zero_scatter(diagnosis: Diagnosis) -> float | None:
    known = math.isfinite(diagnosis.noise) and repeated_passes(diagnosis.stops)
    return diagnosis.loose.zero if known else None
