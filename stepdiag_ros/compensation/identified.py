"""What compensation is made from: an identified error map, reversal errors, and their origin."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from math import nan
from pathlib import Path
from typing import Any

import numpy as np

from stepdiag_ros.bags.passes import Completeness
from stepdiag_ros.metrology.credibility import Misfit, is_noise, misfit
from stepdiag_ros.metrology.discrepancy.summary import NOT_DIAGNOSED, Verdict
from stepdiag_ros.metrology.geometry import AXES, FRAME, Vector
from stepdiag_ros.metrology.learned_displacement import covariance_of, displacements
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.model import ModelEffect
from stepdiag_ros.metrology.plan import LINEAR
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.solvers.catalogue import require_to_rely_on
from stepdiag_ros.metrology.solvers.result import VolumetricErrors
from stepdiag_ros.metrology.standards.axis_test import BidirectionalRuns, all_runs
from stepdiag_ros.metrology.standards.iso230_2 import evaluate
from stepdiag_ros.metrology.volumetric_map import VolumetricMap
from stepdiag_ros.text.controls import one_line
from stepdiag_ros.text.intake import parse_json

NO_REVERSAL = (
    "the reversal errors are not known: no linear line was measured in both directions, or the"
    " source does not hold the lines; both directions are corrected by the same values"
)


@dataclass(frozen=True)
class Origin:
    """Where an identified error map comes from; empty texts where that is not known.

    Attributes:
        file: name of the bag or of the document.
        sha256: of that file, 64 hexadecimal digits.
        run_id: identity of the run.
        run_time: when the run began, ISO 8601, UTC.
        plan: name of the plan.
        machine: name of the machine.
        method: of the solver.
        software_version: of the run.
        verdict: of the diagnosis of the run, with the effects that act.
        despite_verdict: the verdict that the user has overruled; empty: none.

    Raises:
        ValueError: ``sha256`` is not such a number.
    """

    file: str = ""
    sha256: str = ""
    run_id: str = ""
    run_time: str = ""
    plan: str = ""
    machine: str = ""
    method: str = ""
    software_version: str = ""
    verdict: str = ""
    despite_verdict: str = ""

    def __post_init__(self) -> None:
        if not re.fullmatch("(?:[0-9a-f]{64})?", self.sha256):
            raise Refusal(
                f"sha256 is '{one_line(self.sha256)[:70]}', not 64 hexadecimal digits",
                fault="malformed",
                aspect="digest",
            )

    def lines(self) -> list[str]:
        """Return the origin in words, each part on one line that can be shown as it is."""
        titles = {
            "file": "made from",
            "sha256": "SHA-256",
            "run_id": "run",
            "run_time": "measured",
            "plan": "plan",
            "machine": "machine",
            "method": "method",
            "software_version": "run made by stepdiag_ros",
            "verdict": "verdict",
        }
        told = {key: one_line(text) for key, text in asdict(self).items()}
        said = [f"{title}: {told[key] or 'unknown'}" for key, title in titles.items()]
        overruled = told["despite_verdict"]
        return [*said, f"made despite the verdict: {overruled}"] if overruled else said


NO_MORE_THAN_NOISE = (
    "no error stands out from the noise of this measurement: tables made of noise make a machine"
    " worse"
)


@dataclass(frozen=True)
class Identified:
    """The errors of a machine as far as a measurement has determined them.

    Attributes:
        error_map: of the measured box; mean of both directions of approach where both were
            measured.
        reversal: axis (0, 1, 2) → reversal error B = forward - backward (ISO 230-2) of its
            positioning at the nodes of the map, m; an axis whose reversal is not known is not
            there.
        origin: where this comes from.
        remarks: what a reader must know, in words.
        warning: why no tables should be made from these errors; empty: nothing speaks against it.
        verdict: on the run, of a diagnosis.
        passes: how much of the run is there; None if that is not known.
    """

    error_map: VolumetricMap
    reversal: Mapping[int, Vector] = field(default_factory=dict)
    origin: Origin = field(default_factory=Origin)
    remarks: tuple[str, ...] = ()
    warning: str = ""
    verdict: Verdict = field(default_factory=Verdict)
    passes: Completeness | None = None

    def half_reversal(self, axis: int, positions: Vector) -> Vector:
        """Return half the reversal error at positions of an axis, m; zero where it is not known.

        It is added to the mean error on the way forward, and taken from it on the way back.
        """
        places = np.asarray(positions, dtype=np.float64)
        if axis not in self.reversal:
            return np.zeros(places.shape)
        half: Vector = 0.5 * np.interp(places, self.error_map.nodes[axis], self.reversal[axis])
        return half


def identify(
    result: VolumetricErrors,
    chain: str,
    measurement: Measurement | None,
    origin: Origin,
    remarks: Sequence[str] = (),
    verdict: Verdict | None = None,
    passes: Completeness | None = None,
    learned: Sequence[ModelEffect] = (),
) -> Identified:
    """Return what a result says, with the reversal errors of the lines that it was solved from.

    Args:
        result: of a solver.
        chain: order of the machine's axes from workpiece to tool; empty if not known.
        measurement: the lines; None if they are not at hand.
        origin: of both.
        remarks: about the run.
        verdict: on the run, of a diagnosis; None if it was not diagnosed.
        passes: how much of the run is there; None if that is not known.
        learned: displacements that were taken off the lines before they were solved.

    Raises:
        ValueError: the result is not enough for a map; the text says what is missing.
    """
    error_map = with_learned(VolumetricMap.of_result(result, chain), learned)
    reversal: dict[int, Vector] = {}
    said = [*remarks, *result.remarks]
    for runs in () if measurement is None else all_runs(measurement):
        if runs.kind != LINEAR or not len(runs.forward) or not len(runs.backward):
            continue
        axis = AXES.index(runs.name)
        found, words = reversal_of(runs, _stop_uncertainty(measurement, runs))
        reversal[axis] = np.interp(error_map.nodes[axis], runs.target, found)
        said += [f"reversal of {runs.name}: {remark}" for remark in (words, *runs.remarks)]
    if not reversal:
        said.append(NO_REVERSAL)
    agreement = misfit(result, measurement)
    disagreement = _disagreement(result, agreement)
    warning = disagreement if agreement is Misfit.SHOWN else ""
    if not warning and is_noise(result) and not any(map(np.any, reversal.values())):
        warning = NO_MORE_THAN_NOISE
    said += [one for one in (disagreement, warning) if one]
    known = verdict or Verdict()
    if known.name != NOT_DIAGNOSED:
        origin = replace(origin, verdict=known.words)
    told = tuple(dict.fromkeys(said))
    return Identified(error_map, reversal, origin, told, warning, known, passes)


def with_learned(error_map: VolumetricMap, learned: Sequence[ModelEffect]) -> VolumetricMap:
    """Return a map with learned displacements beside its curves.

    Raises:
        ValueError: the map reaches beyond the domain in which one was learned.
    """
    return replace(
        error_map,
        learned=displacements(learned, error_map.low, error_map.high),
        learned_covariance=covariance_of(learned),
    )


def _disagreement(result: VolumetricErrors, agreement: Misfit) -> str:
    """Say that the readings disagree with the model; nothing where they agree."""
    if agreement is Misfit.NONE:
        return ""
    told = (
        "the readings disagree with this model (reduced chi squared"
        f" {result.chi_squared / result.degrees_of_freedom:.3g}): "
    )
    if agreement is Misfit.UNCLEAR:
        return (
            told
            + "they repeat worse than their windows show, or an effect acts that the model lacks."
            " Run 'stepdiag diagnose' first"
        )
    return (
        told + "something acts that is not in it, such as angular errors, drift or growth, and part"
        " of it is in these values, so that it is not known how well they are known; see"
        " 'stepdiag diagnose' first"
    )


def reversal_of(runs: BidirectionalRuns, stop_uncertainty: float = nan) -> tuple[Vector, str]:
    """Return the reversal errors of an axis as far as they stand out from noise, and in words how.

    B_i = mean forward - mean backward (ISO 230-2). Where a constant explains all of them, their
    mean is taken, which is known better than each; where zero does, zero: tables made of noise make
    a machine worse. Judged by chi squared, which must not exceed its expectation by more than three
    of its standard deviations. With unknown noise the values are taken as they are.

    Args:
        runs: of the axis, in both directions.
        stop_uncertainty: standard uncertainty of a reading at a stop, m; NaN if not known.

    Returns:
        at the targets of the runs, m, shape (m,); words.
    """
    found = evaluate(runs).reversal
    noise = max(_scatter(runs), stop_uncertainty, key=lambda u: -1.0 if np.isnan(u) else u)
    if not noise > 0.0:
        return found, "taken as measured, since the noise of a stop is not known"
    spread = noise * float(np.sqrt(1.0 / len(runs.forward) + 1.0 / len(runs.backward)))
    nothing = np.zeros(len(found))
    if _explained(found / spread, len(found)):
        return nothing, "zero within the noise, and not compensated"
    constant = np.full(len(found), np.mean(found))
    if _explained((found - constant) / spread, len(found) - 1):
        return constant, f"{constant[0] * 1e6:.3f} µm, the same everywhere within the noise"
    return found, "differs from place to place"


def _explained(residuals: Vector, freedom: int) -> bool:
    """Say whether residuals, in standard deviations, are noise."""
    return bool(residuals @ residuals <= freedom + 3.0 * np.sqrt(2.0 * freedom))


def _scatter(runs: BidirectionalRuns) -> float:
    """Return the pooled standard deviation of a stop from repeated runs, m; NaN from single ones.

    A shift of a whole run, such as a drift between runs, is part of it.
    """
    squares, freedom = 0.0, 0
    for one in (runs.forward, runs.backward):
        if len(one) > 1:
            squares += float(np.sum((one - np.mean(one, axis=0)) ** 2))
            freedom += (len(one) - 1) * one.shape[1]
    return float(np.sqrt(squares / freedom)) if freedom else nan


def _stop_uncertainty(measurement: Measurement | None, runs: BidirectionalRuns) -> float:
    """Return the rms standard uncertainty of the stops of some runs, m; NaN if not known."""
    lines = () if measurement is None else measurement.lines
    squares = [
        line.standard_uncertainty**2
        for line in lines
        if line.setup == runs.setup and line.line.kind == runs.kind
    ]
    return float(np.sqrt(np.mean(np.concatenate(squares)))) if squares else nan


def from_results_file(path: Path, method: str, digest: str) -> Identified:
    """Return what a ``results.json`` (schema ``result``) says; it holds no lines, so no reversal.

    Args:
        path: of the document.
        method: of the solver; empty: the one to rely on.
        digest: SHA-256 of the file.

    Raises:
        ValueError: it is not such a document, or lacks the method or what a map needs.
    """
    try:
        document = parse_json(path.read_text(encoding="utf-8"), str(path))
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} is not a JSON document: {error}") from None
    schema = document.get("schema") if isinstance(document, dict) else None
    if not isinstance(schema, str) or not schema.startswith("urn:stepdiag_ros:result:"):
        raise ValueError(f"{path} is not a result of 'stepdiag solve' (results.json), nor a bag")
    try:
        methods = document["methods"]
        known = list(methods)
        if method and method not in methods:
            raise ValueError(f"{path} has no method '{method}'; it has {', '.join(known)}")
        if not known:
            raise ValueError(f"{path}: no method could be used on its lines")
        name = method or require_to_rely_on(known, str(path))
        result = _result(methods[name], name)
        run = document["run"]
        origin = Origin(
            file=path.name,
            sha256=digest,
            run_id=run.get("run_id") or "",
            plan=run.get("plan") or "",
            machine=run.get("machine") or "",
            method=name,
            software_version=run.get("software_version") or "",
        )
        verdict, passes = _told_first(document.get("lead"))
        chain, remarks = run.get("chain") or "", run.get("remarks", ())
        return identify(result, chain, None, origin, remarks, verdict, passes)
    except (KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"{path} does not fit the schema 'result': {error}") from None


def require_run(found: Identified, path: Path, run_id: str | None) -> Identified:
    """Return what a document says; it is of the run that was asked for.

    Args:
        found: the errors.
        path: of the document.
        run_id: of the run; None: any.

    Raises:
        Refusal: it is of another run.
    """
    own = found.origin.run_id
    if run_id is not None and run_id != own:
        raise Refusal(
            f"{path} holds no run '{run_id}', but {own or 'one without an identity'}. Name that"
            " run, or leave out --run",
            fault="not_found",
            about=run_id,
            where=str(path),
        )
    return found


def _told_first(lead: Mapping[str, Any] | None) -> tuple[Verdict, Completeness | None]:
    """Return verdict and completeness of a document's lead, which earlier versions lack."""
    if lead is None:
        return Verdict(), None
    said, passes = lead["verdict"], lead["passes"]
    verdict = Verdict(
        *(said["name"], said["sentence"], tuple(said["effects"]), tuple(said["rivals"])),
        contained=said.get("contained", False),
    )
    if passes is None:
        return verdict, None
    return verdict, Completeness(
        *(passes["planned"], passes["complete"], tuple(passes["missing"])),
        end=passes["end"] or "",
        unit=passes["unit"],
    )


def _result(entry: Mapping[str, Any], method: str) -> VolumetricErrors:
    x, y, z = (known_numbers(entry["nodes"][letter]) for letter in AXES)
    return VolumetricErrors(
        method=method,
        nodes=(x, y, z),
        curves={name: known_numbers(values) for name, values in entry["curves"].items()},
        standard_uncertainty={
            name: known_numbers(values) for name, values in entry["standard_uncertainty"].items()
        },
        figures=(),
        lines=int(entry["lines"]),
        chi_squared=nan if entry["chi_squared"] is None else float(entry["chi_squared"]),
        degrees_of_freedom=int(entry["degrees_of_freedom"]),
        not_determined=tuple(entry["not_determined"]),
        remarks=tuple(entry["remarks"]),
        frame=str(entry.get("frame", FRAME)),
    )


def known_numbers(values: Sequence[float | None]) -> Vector:
    """Return numbers of a JSON document, ``null`` as NaN."""
    return np.array([nan if value is None else float(value) for value in values])


def curve_at(identified: Identified, name: str, positions: Vector) -> Vector:
    """Return an error curve, with what it can hold of learned errors, at positions of its axis.

    Args:
        identified: the errors.
        name: of the curve, such as E_YX.
        positions: m, shape (n,).
    """
    return identified.error_map.held_by_curves(name, positions)
