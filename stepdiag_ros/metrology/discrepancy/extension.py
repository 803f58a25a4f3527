"""From a diagnosis to a better model: add what was named, compare again, prove it, until it holds.

Effects are found one after another and then fitted together: each round compares the run with the
model that has all effects named so far, their sizes free.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stepdiag_ros.metrology.discrepancy.baseline import Baseline, fit_baseline, without_readings
from stepdiag_ros.metrology.discrepancy.diagnose import diagnose
from stepdiag_ros.metrology.discrepancy.findings import DESCRIBED, NAMED, Candidate, Diagnosis
from stepdiag_ros.metrology.discrepancy.held_out import HeldOut, prove
from stepdiag_ros.metrology.discrepancy.steady import steadied
from stepdiag_ros.metrology.effects.domain import Domain
from stepdiag_ros.metrology.effects.effect import ActiveEffect, Effect
from stepdiag_ros.metrology.effects.learned_shape import Learned, quantities
from stepdiag_ros.metrology.effects.stops import Stops, stops_of
from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.model import FITTED, FIXED, MachineModel, ModelEffect, Provenance
from stepdiag_ros.metrology.refusal import Refusal

_MOST_ROUNDS = 4
_MORE = (NAMED, DESCRIBED)
"""Verdicts by which a model grows."""


@dataclass(frozen=True)
class Extension:
    """What came of a run and a model.

    Attributes:
        diagnosis: of the run under the model as it was.
        model: with the named effects added; None if nothing was named.
        rounds: diagnoses under the extended model; the last is the one of ``model``.
        held_out: the proof; None if nothing was named, or no part of the run can be held out.
    """

    diagnosis: Diagnosis
    model: MachineModel | None
    rounds: tuple[Diagnosis, ...]
    held_out: HeldOut | None


@dataclass(frozen=True)
class ModelComparison:
    """How a run is compared with a model; the same for every round.

    Attributes:
        measurement: the run.
        catalogue: effects to try; all that are installed if None.
        seed: of the draws that show the influence of chance.
        tell: called with what is being done.
    """

    measurement: Measurement
    catalogue: Iterable[Effect] | None = None
    seed: int = 0
    tell: Callable[[str], None] | None = None

    def under(self, model: MachineModel, measurement: Measurement | None = None) -> Diagnosis:
        """Return the diagnosis of the run, or of a part of it, under a model."""
        return diagnose(
            measurement or self.measurement,
            known=model.of_status(FIXED),
            catalogue=self.catalogue,
            seed=self.seed,
            progress=self.tell,
            fitted=model.of_status(FITTED),
            curves=model.curves,
        )


def with_chain(measurement: Measurement, model: MachineModel) -> Measurement:
    """Return the measurement with the model's kinematic chain.

    Raises:
        ValueError: run and model name different chains.
    """
    if not model.chain:
        return measurement
    if measurement.chain and measurement.chain != model.chain:
        raise Refusal(
            f"the run is of a machine with the chain {measurement.chain}, the model of one with"
            f" {model.chain}; correct the one that is wrong",
            fault="mismatch",
        )
    return replace(measurement, chain=model.chain)


def extend(
    comparison: ModelComparison,
    model: MachineModel,
    provenance: Provenance,
    status: str = FITTED,
    again: bool = True,
) -> Extension:
    """Diagnose a run, add what is named to the model, and go on until nothing more is named.

    Args:
        comparison: the run and how it is compared.
        model: what is taken as known.
        provenance: of what is added; the evidence is written here.
        status: of what is added, ``fixed`` or ``fitted``.
        again: compare the run with the extended model too.

    Raises:
        ValueError: the run cannot be compared; one sentence.
    """
    diagnosis = comparison.under(model)
    if diagnosis.verdict not in _MORE:
        return Extension(diagnosis, None, (), None)
    proof = prove(
        comparison.measurement,
        diagnosis,
        _baseline(comparison.measurement, model),
        lambda part: comparison.under(model, part),
    )
    extended = model.with_effects(named_effects(diagnosis, provenance, FITTED, proof))
    rounds: list[Diagnosis] = []
    last = diagnosis
    while again and last.verdict in _MORE and len(rounds) < _MOST_ROUNDS:
        last = comparison.under(extended)
        rounds.append(last)
        if last.verdict in _MORE:
            extended = extended.with_effects(named_effects(last, provenance, FITTED))
    before = {effect.label for effect in model.effects}
    extended = replace(
        extended,
        effects=tuple(
            effect if effect.label in before else replace(effect, status=status)
            for effect in extended.effects
        ),
    )
    return Extension(diagnosis, extended, tuple(rounds), proof)


def named_effects(
    diagnosis: Diagnosis, provenance: Provenance, status: str, proof: HeldOut | None = None
) -> tuple[ModelEffect, ...]:
    """Return the named effects as a model has them, with the evidence for each."""
    covariances = _covariances(diagnosis)
    return tuple(
        ModelEffect(
            ActiveEffect(
                _learned_here(finding.candidate, diagnosis.stops),
                dict(finding.candidate.setting),
                dict(finding.sizes),
            ),
            dict(finding.standard_uncertainty),
            status,
            replace(
                provenance,
                evidence=f"chi-squared {diagnosis.chi_squared_before:.1f} with"
                f" {diagnosis.degrees_of_freedom_before} degrees of freedom before,"
                f" {diagnosis.chi_squared_after:.1f} with {diagnosis.degrees_of_freedom_after}"
                f" after; {finding.gain:.1f} of it by this effect, p {_small(finding.p_value)}"
                f" among {diagnosis.tested} candidates, probability {finding.probability:.4f}"
                + _proof_words(proof),
            ),
            covariances.get(finding.label, {}),
        )
        for finding in diagnosis.findings
    )


def _learned_here(candidate: Candidate, stops: Stops) -> Effect:
    """Return the effect of a candidate; what is learned with its domain."""
    effect = candidate.effect
    if not isinstance(effect, Learned):
        return effect
    names = quantities(str(candidate.setting["shape"]))
    return replace(effect, domain=Domain.of(names, stops))


def _covariances(diagnosis: Diagnosis) -> dict[str, dict[str, float]]:
    """Return the covariances of the amplitudes that were learned together, by their labels."""
    rows = np.cumsum([0, *(len(one.candidate.effect.sizes) for one in diagnosis.findings)])
    learned = [
        (one.label, row)
        for one, row in zip(diagnosis.findings, rows.tolist(), strict=False)
        if one.candidate.effect.learned
    ]
    return {
        label: {
            other: float(diagnosis.covariance[row, column])
            for other, column in learned
            if other != label
        }
        for label, row in learned
    }


def _small(chance: float) -> str:
    return "< 0.0001" if chance < 1e-4 else f"= {chance:.4f}"


def _proof_words(proof: HeldOut | None) -> str:
    if proof is None or not math.isfinite(proof.after.reduced):
        return ""
    return (
        f"; held out {proof.split}: chi-squared per degree of freedom {proof.before.reduced:.3f}"
        f" before, {proof.after.reduced:.3f} after"
    )


def without_effects(measurement: Measurement, effects: Sequence[ActiveEffect]) -> Measurement:
    """Return the measurement as it would be read if these effects did not act."""
    stops = steadied(stops_of(measurement))
    taken: Vector = np.zeros(len(stops.time))
    for effect in effects:
        taken = taken + effect.readings(stops)
    return without_readings(measurement, taken)


def _baseline(measurement: Measurement, model: MachineModel) -> Baseline:
    return fit_baseline(
        measurement,
        steadied(stops_of(measurement)),
        model.of_status(FIXED),
        model.of_status(FITTED),
        model.curves,
    )
