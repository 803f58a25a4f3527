"""From a measurement and a model to everything that is shown of their comparison."""

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

from threadpoolctl import ThreadpoolController

from stepdiag_ros.metrology.discrepancy.extension import (
    Comparison,
    extend,
    with_chain,
    without_effects,
)
from stepdiag_ros.metrology.discrepancy.findings import Diagnosis
from stepdiag_ros.metrology.effects.effect import Effect
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.model import FITTED, MachineModel, Provenance
from stepdiag_ros.metrology.solvers.least_squares import solve_least_squares
from stepdiag_ros.metrology.solvers.result import NotDeterminable, VolumetricErrors
from stepdiag_ros.report.diagnosis import DiagnosisReport

_CHUNK = 1 << 20


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file, 64 hexadecimal digits.

    Raises:
        OSError: it cannot be read.
    """
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while chunk := file.read(_CHUNK):
            digest.update(chunk)
    return digest.hexdigest()


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
) -> DiagnosisReport:
    """Compare a run with a model, extend the model by what is named, and prove it.

    Args:
        measurement: the run.
        model: what is taken as known.
        catalogue: effects to try, by name.
        bag: the file, whose SHA-256 goes into the provenance of what is added.
        date: of today, ISO 8601, for the same.
        run_id: identity of the run; empty if it has none.
        model_source: file of the model; empty if none was given.
        status: of effects that are added to the model, ``fixed`` or ``fitted``.
        again: compare the run with the extended model too.
        seed: of the draws that tell what chance does.
        tell: told what is being done.
        remarks: about the run as a whole.

    Raises:
        ValueError: run and model contradict each other, or the run cannot be compared.
    """
    measured = with_chain(measurement, model)
    model = replace(model, chain=measured.chain)
    sha256 = "" if bag is None else sha256_of(bag)
    # One thread gives the same numbers on every machine, and is the fastest for these matrices.
    with ThreadpoolController().limit(limits=1, user_api="blas"):
        made = extend(
            Comparison(measured, tuple(catalogue.values()), seed, tell),
            model,
            Provenance(bag="" if bag is None else bag.name, sha256=sha256, date=date),
            status,
            again,
        )
        curves = _curves(measured, model, made.diagnosis)
    further = (
        ("The machine's kinematic chain is not known: angular errors were not tried.",)
        if not measured.chain
        else ()
    )
    return DiagnosisReport(
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
        remarks=(*remarks, *further),
    )


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
