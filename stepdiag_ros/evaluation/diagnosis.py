"""From a measurement and a model to everything that is shown of their comparison."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from stepdiag_ros.bags.digest import sha256_of
from stepdiag_ros.evaluation.solving import one_thread
from stepdiag_ros.metrology.discrepancy.extension import (
    ModelComparison,
    extend,
    with_chain,
    without_effects,
)
from stepdiag_ros.metrology.discrepancy.findings import Diagnosis, Finding
from stepdiag_ros.metrology.discrepancy.held_out import HeldOut
from stepdiag_ros.metrology.discrepancy.proposal import ExtraPlan
from stepdiag_ros.metrology.effects.effect import Effect
from stepdiag_ros.metrology.effects.learned_shape import outside, without_domain
from stepdiag_ros.metrology.effects.stops import stops_of
from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.machine import Machine
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.model import FITTED, FIXED, TOGETHER, MachineModel, Provenance
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.metrology.solvers.least_squares import solve_least_squares
from stepdiag_ros.metrology.solvers.result import NotDeterminable, VolumetricErrors
from stepdiag_ros.planning.separation import propose_extra

NO_CHAIN = "The machine's kinematic chain is not known: angular errors were not tried."


@dataclass(frozen=True)
class RunFile:
    """A further run that was diagnosed together with the first.

    Attributes:
        path: of the file.
        sha256: of the file.
        run_id: identity of the run; empty if it has none.
    """

    path: Path
    sha256: str
    run_id: str = ""


@dataclass(frozen=True)
class DiagnosisReport:
    """What is shown of a diagnosis.

    Attributes:
        diagnosis: of the run under the model as it was.
        model: as it was.
        catalogue: effects that were tried, by name.
        bag: the file.
        sha256: of the file.
        run_id: identity of the run; empty if it has none.
        model_source: file of the model; empty if none was given.
        extended: the model with the named effects; None if nothing was named.
        extended_path: file that it was written to; None if it was not.
        rounds: diagnoses under the extended model, one after another until nothing more is named.
        held_out: proof on data that took no part in the fit; None without a proof.
        curves: error curves before and after the effects were taken off; None if not solved.
        remarks: about the run as a whole.
        further: runs that were diagnosed together with that of ``bag``; the second run of what is
            shown is the first of these.
        proposal: of an extra plan for what is left open; None if none was asked for.
        proposal_path: file that the plan was written to; None if it was not.
    """

    diagnosis: Diagnosis
    model: MachineModel
    catalogue: Mapping[str, Effect]
    bag: Path | None = None
    sha256: str = ""
    run_id: str = ""
    model_source: str = ""
    extended: MachineModel | None = None
    extended_path: Path | None = None
    rounds: tuple[Diagnosis, ...] = ()
    held_out: HeldOut | None = None
    curves: tuple[VolumetricErrors, VolumetricErrors] | None = None
    remarks: tuple[str, ...] = ()
    further: tuple[RunFile, ...] = ()
    proposal: ExtraPlan | None = None
    proposal_path: Path | None = None

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Return what was found, or where the gap is unexplained what closes a part of it."""
        return self.diagnosis.findings or self.diagnosis.partial


def rms_and_largest(residual: Vector) -> tuple[float, float]:
    """Return rms and largest of a gap, m; NaN where there is no reading at all."""
    known = residual[np.isfinite(residual)]
    if not known.size:
        return math.nan, math.nan
    return float(np.sqrt(np.mean(known**2))), float(np.max(np.abs(known)))


def model_remarks(measurement: Measurement, model: MachineModel) -> tuple[str, ...]:
    """Say where a run takes the learned effects of a model outside their domains, if it does.

    Args:
        measurement: the run, at least one line.
        model: with which it is compared.
    """
    active = [effect.active for effect in model.effects]
    return (*outside(active, stops_of(measurement)), *without_domain(active))


@dataclass(frozen=True)
class Ask:
    """Conditions of an extra plan.

    Attributes:
        conditions: a plan with the feed and sampling of the run; None: as its times show.
        machine: that will measure it; None if not known.
    """

    conditions: Plan | None = None
    machine: Machine | None = None


def build_diagnosis(
    measurement: Measurement,
    model: MachineModel,
    catalogue: Mapping[str, Effect],
    *,
    bag: Path | None = None,
    date: str = "",
    run_id: str = "",
    model_source: str = "",
    status: str = FITTED,
    again: bool = True,
    seed: int = 0,
    tell: Callable[[str], None] | None = None,
    remarks: tuple[str, ...] = (),
    further: Sequence[tuple[Path, str]] = (),
    ask: Ask | None = None,
) -> DiagnosisReport:
    """Compare a run with a model, extend the model by what is named, and prove it.

    Args:
        measurement: the run, or several (``discrepancy.joint``).
        model: what is taken as known.
        catalogue: effects to try, by name.
        bag: the file, whose SHA-256 goes into the provenance of what is added.
        date: of today, ISO 8601, for the same.
        run_id: identity of the run; empty if it has none.
        model_source: file of the model; empty if none was given.
        status: of effects that are added to the model, ``fixed`` or ``fitted``.
        again: compare the run with the extended model too.
        seed: of the draws that show the influence of chance.
        tell: called with what is being done.
        remarks: about the run as a whole.
        further: file and identity of each run that is joined to that of ``bag``.
        ask: under which conditions an extra plan is sought for what is left open; None: none is.

    Raises:
        ValueError: run and model contradict each other, or the run cannot be compared.
    """
    measured = with_chain(measurement, model)
    model = replace(model, chain=measured.chain)
    sha256 = "" if bag is None else sha256_of(bag)
    others = tuple(RunFile(path, sha256_of(path), identity) for path, identity in further)
    # One thread gives the same numbers on every machine, and is the fastest for these matrices.
    with one_thread():
        made = extend(
            ModelComparison(measured, tuple(catalogue.values()), seed, tell),
            model,
            Provenance(
                bag=TOGETHER.join(
                    [*([] if bag is None else [bag.name]), *(one.path.name for one in others)]
                ),
                sha256=TOGETHER.join([sha256, *(one.sha256 for one in others)]),
                date=date,
            ),
            status,
            again,
        )
        curves = _curves(measured, model, made.diagnosis)
    chainless = () if measured.chain else (NO_CHAIN,)
    report = DiagnosisReport(
        diagnosis=made.diagnosis,
        model=model,
        catalogue=catalogue,
        bag=bag,
        sha256=sha256,
        run_id=run_id,
        model_source=model_source,
        extended=made.model,
        rounds=made.rounds,
        held_out=made.held_out,
        curves=curves,
        remarks=(*remarks, *chainless, *model_remarks(measured, model)),
        further=others,
    )
    if ask is None:
        return report
    if tell is not None:
        tell("seeking an extra plan")
    return with_proposal(report, measured, ask)


def with_proposal(report: DiagnosisReport, measurement: Measurement, ask: Ask) -> DiagnosisReport:
    """Return a diagnosis with an extra plan for what it leaves open.

    Args:
        report: of ``build_diagnosis``.
        measurement: that it is of.
        ask: conditions of the plan.
    """
    model = report.model
    proposal = propose_extra(
        with_chain(measurement, model),
        report.diagnosis,
        ask.conditions,
        ask.machine,
        model.of_status(FIXED),
        tuple(report.catalogue.values()),
        model.of_status(FITTED),
        model.curves,
    )
    return replace(report, proposal=proposal)


def _curves(
    measurement: Measurement, model: MachineModel, diagnosis: Diagnosis
) -> tuple[VolumetricErrors, VolumetricErrors] | None:
    if not diagnosis.findings or model.curves:
        return None
    known = [effect.active for effect in model.effects]
    found = [finding.active for finding in diagnosis.findings]
    try:
        before = solve_least_squares(without_effects(measurement, known))
        after = solve_least_squares(without_effects(measurement, [*known, *found]))
    except NotDeterminable:
        return None
    return before, after
