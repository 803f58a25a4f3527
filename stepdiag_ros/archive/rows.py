"""From a bag to the rows of its runs, by the functions that every command evaluates with."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime, timedelta, timezone
from math import isfinite, nan
from pathlib import Path
from typing import Any

import numpy as np

from stepdiag_ros import __version__
from stepdiag_ros.archive.columns import Curve, Figure, Run
from stepdiag_ros.bags.folder import open_bag
from stepdiag_ros.bags.header import PARAMETERS
from stepdiag_ros.bags.run import RecordedRun, load_run
from stepdiag_ros.bags.runs import FoundRun, runs_in
from stepdiag_ros.evaluation.budget import with_budget
from stepdiag_ros.evaluation.compensation import ANY_DATE
from stepdiag_ros.evaluation.diagnosing import verdict_and_effects
from stepdiag_ros.evaluation.history import machine_facts
from stepdiag_ros.evaluation.lead import RunLead, lead_of
from stepdiag_ros.evaluation.recorded_run import measurement_of, report_of_run
from stepdiag_ros.evaluation.report import Report
from stepdiag_ros.evaluation.scatter import layout_digest, scatter_of_figures, scatter_of_largest
from stepdiag_ros.evaluation.single_errors import expanded_of_figure
from stepdiag_ros.evaluation.solving import solve_run
from stepdiag_ros.metrology.discrepancy.summary import FoundEffect, Verdict
from stepdiag_ros.metrology.geometry import curve_unit
from stepdiag_ros.metrology.measurement import Environment, Measurement
from stepdiag_ros.metrology.standards.axis_test import all_runs
from stepdiag_ros.metrology.standards.iso230_2 import PositioningTest, evaluate
from stepdiag_ros.text.intake import parse_yaml
from stepdiag_ros.text.sentence import sentence

_EPOCH = datetime(1970, 1, 1, tzinfo=timezone.utc)
_IDENTITY = ("run_id", "machine", "serial_number", "start_time")
_INSTRUMENT, _WEATHER = "/interferometer", "/weather"
"""Ends of the names of the nodes whose parameters state instrument and weather station."""


@dataclass(frozen=True)
class Rows:
    """The rows of a bag.

    Attributes:
        runs: one a run.
        figures: of all runs.
        curves: of all runs.
    """

    runs: list[Run] = field(default_factory=list)
    figures: list[Figure] = field(default_factory=list)
    curves: list[Curve] = field(default_factory=list)


def rows_of_bag(path: Path, sha256: str, part: str) -> Rows:
    """Evaluate each run of a bag and return its rows; a run that is refused has a ``problem``.

    The rows depend on nothing but the bag, its name and this software.

    Args:
        path: of the bag.
        sha256: of the bag.
        part: of the catalogue that the rows are for.
    """
    rows = Rows()
    key: dict[str, Any] = {"part": part, "bag_sha256": sha256}
    try:
        with open_bag(path) as bag:
            found: list[FoundRun | None] = [*runs_in(bag).values()] or [None]
    except (ValueError, OSError) as error:
        rows.runs.append(_refused(error, path, key, {}, 1))
        return rows
    for number, one in enumerate(found, 1):
        stated = {} if one is None else _stated_first(one)
        try:
            recorded = load_run(path, None if one is None else one.run_id)
            try:
                stated = _stated(recorded)
                _add(recorded, key, stated, number, rows)
            finally:
                recorded.bag.close()
        except ValueError as error:
            rows.runs.append(_refused(error, path, key, stated, number))
    return rows


def _refused(
    error: Exception, path: Path, key: dict[str, Any], stated: dict[str, Any], number: int
) -> Run:
    """Return the row of a run that cannot be evaluated, with what is known of it all the same."""
    unknown = dict.fromkeys(one for one in Run.__dataclass_fields__ if one not in key)
    known: dict[str, Any] = {
        "run_number": number,
        "file": path.name,
        "effects": (),
        # Where the bag lies differs from computer to computer.
        "problem": sentence(error).replace(str(path), path.name),
        "software_version": __version__,
        "figure_count": 0,
        "curve_count": 0,
    }
    return Run(**{**unknown, **key, **stated, **known})


def _stated_first(found: FoundRun) -> dict[str, Any]:
    """Return what the description of a run states, whatever the version of its messages."""
    return {
        "run_id": found.run_id or None,
        "start_time": _time(found.start_time),
        "run_software_version": str(found.description.software_version) or None,
    }


def _stated(recorded: RecordedRun) -> dict[str, Any]:
    """Return what a run states of itself, before it is evaluated."""
    facts = machine_facts(recorded)
    told = recorded.told_by_source
    nodes = _parameters(recorded)
    driver, serial = _device(nodes, _INSTRUMENT)
    station, sensors = _device(nodes, _WEATHER)
    return {
        **_stated_first(recorded.found),
        "machine": facts.get("name"),
        "serial_number": facts.get("serial number"),
        "instrument": told.get("instrument") or driver,
        "instrument_serial_number": told.get("instrument_serial_number") or serial,
        "weather_station": sensors or station,
        "plan": recorded.plan.name or None,
        "chain": recorded.chain or None,
        "simulated": True if recorded.simulated_cell else None,
    }


def _add(
    recorded: RecordedRun, key: dict[str, Any], stated: dict[str, Any], number: int, rows: Rows
) -> None:
    report, tests, effects = _evaluated(recorded)
    lead = lead_of(report)
    own = {**key, **{name: stated[name] for name in _IDENTITY}}
    figures = [Figure(**own, **one) for one in _figures(report, lead, tests, effects)]
    curves = [Curve(**own, **one) for one in _curves(report)]
    preferred, verdict = report.preferred(), report.verdict
    rows.figures.extend(figures)
    rows.curves.extend(curves)
    rows.runs.append(
        Run(
            **key,
            **stated,
            run_number=number,
            file=recorded.path.name,
            layout=None if report.measurement is None else layout_digest(report.measurement),
            complete=lead.whole,
            flaws=len(report.recording),
            **_environment(report.measurement),
            method=None if preferred is None else preferred.method,
            largest_m=None if lead.volume is None else _known(lead.volume.value),
            largest_expanded_uncertainty_m=_known(lead.expanded_uncertainty),
            largest_upper_bound_m=None
            if lead.volume is None
            else _known(lead.volume.upper_bound(lead.expanded_uncertainty)),
            verdict=verdict.name,
            verdict_sentence=verdict.sentence,
            effects=verdict.effects,
            contained=verdict.contained,
            problem=None,
            software_version=__version__,
            figure_count=len(figures),
            curve_count=len(curves),
        )
    )


def _evaluated(
    recorded: RecordedRun,
) -> tuple[Report, Sequence[PositioningTest], Sequence[FoundEffect]]:
    """Return report, tests of positioning, and effects that act."""
    if recorded.plan.tracker is not None:
        return (*_evaluated_tracker(recorded), ())
    report = report_of_run(recorded)
    measurement = report.measurement
    if measurement is None or not measurement.lines:
        return report, (), ()
    verdict, effects = verdict_and_effects(measurement)
    try:
        tests = [evaluate(one) for one in all_runs(measurement)]
    except ValueError:  # passes that are no repetitions of each other
        tests = []
    return with_budget(replace(report, verdict=verdict)), tests, effects


def _evaluated_tracker(recorded: RecordedRun) -> tuple[Report, Sequence[PositioningTest]]:
    # Only here: few runs have a tracker, and its evaluation takes time to import.
    from stepdiag_ros.metrology.tracker.run_result import verdict_on_run

    measurement, _ = measurement_of(recorded)
    if not measurement.lines:
        raise ValueError(f"{recorded.path}: no line was finished, so there is nothing to evaluate")
    solved = solve_run(recorded.plan, measurement, measurement.lines[-1])
    report = Report(
        results=tuple(solved.results.values()),
        refused=solved.refused,
        run_id=recorded.run_id,
        chain=recorded.chain,
        measurement=measurement,
        verdict=Verdict(*verdict_on_run(recorded.plan, measurement.lines, measurement.chain)),
        recording=recorded.flaws,
    )
    return report, solved.tests


def _figures(
    report: Report,
    lead: RunLead,
    tests: Iterable[PositioningTest],
    effects: Iterable[FoundEffect],
) -> Iterator[dict[str, Any]]:
    preferred = report.preferred()
    best = None if preferred is None else preferred.method
    for result in report.ordered_results():
        scatter = scatter_of_figures(result, report.chain)
        for one in result.figures:
            yield _figure(
                "result",
                result.method,
                one.name,
                one.unit,
                one.value,
                expanded_of_figure(one, report.budget if result is preferred else None).value,
                standard_uncertainty=one.standard_uncertainty,
                scatter=scatter.get(one.name, nan),
                relied_on=result.method == best,
            )
    if lead.volume is not None and preferred is not None:
        name, wide = "largest in volume", lead.expanded_uncertainty
        scatter_of_it = scatter_of_largest(preferred, report.chain)
        yield _figure("volume", best, name, "m", lead.volume.value, wide, scatter=scatter_of_it)
    for error in lead.errors:
        yield _figure("single", best, error.name, "m", error.value, error.expanded_uncertainty)
    for test in tests:
        for name, value in test.parameters.items():
            wide = test.expanded_uncertainty.get(name, nan)
            yield _figure(test.standard, None, f"{name} {test.name}", "m", value, wide)
    for effect in effects:
        for size in effect.sizes:
            yield _figure(
                "effect",
                None,
                f"{effect.label}: {size.name}",
                size.unit,
                size.value,
                0.5 * (size.band[1] - size.band[0]),
                standard_uncertainty=size.standard_uncertainty,
            )


def _figure(
    kind: str,
    method: str | None,
    name: str,
    unit: str,
    value: float,
    expanded: float,
    *,
    standard_uncertainty: float = nan,
    scatter: float = nan,
    relied_on: bool = True,
) -> dict[str, Any]:
    return {
        "kind": kind,
        "method": method,
        "name": name,
        "unit": unit,
        "value": _known(value),
        "standard_uncertainty": _known(standard_uncertainty),
        "scatter_standard_uncertainty": _known(scatter),
        "expanded_uncertainty": _known(expanded),
        "low": _known(value - expanded),
        "high": _known(value + expanded),
        "relied_on": relied_on,
    }


def _curves(report: Report) -> Iterator[dict[str, Any]]:
    preferred = report.preferred()
    for result in report.ordered_results():
        for name in result.curves:
            yield {
                "method": result.method,
                "name": name,
                "unit": curve_unit(name),
                "position_m": [float(one) for one in result.nodes_of(name)],
                "value": [_known(one) for one in result.curves[name]],
                "standard_uncertainty": [_known(one) for one in result.standard_uncertainty[name]],
                "relied_on": preferred is not None and result.method == preferred.method,
            }


def _parameters(recorded: RecordedRun) -> dict[str, Any]:
    """Return the parameters of each node, as far as the bag states them."""
    text = next((one.data for one in recorded.bag.attachments if one.name == PARAMETERS), b"")
    nodes = parse_yaml(text.decode(errors="replace"), PARAMETERS) if text else {}
    return nodes if isinstance(nodes, dict) else {}


def _device(nodes: dict[str, Any], node_ending: str) -> tuple[str | None, str | None]:
    """Return driver and hardware_id of a node's device, as far as its parameters state them."""
    names: list[Any] = [None, None]
    for node, values in nodes.items():
        if f"/{node}".endswith(node_ending) and isinstance(values, dict):
            names = [names[0] or values.get("device"), names[1] or values.get("hardware_id")]
    driver, identity = (str(one) if one else None for one in names)
    return driver, identity


def _environment(measurement: Measurement | None) -> dict[str, Any]:
    lines = () if measurement is None else measurement.lines
    rows = [np.asarray(line.environment, float).reshape(-1, len(Environment())) for line in lines]
    columns = np.concatenate(rows).T if rows else np.empty((len(Environment()), 0))
    known = [column[np.isfinite(column)] for column in columns]
    means = Environment(*(float(np.mean(one)) if one.size else nan for one in known))
    material = known[Environment._fields.index("material_temperature")]
    return {
        "air_temperature_degC": _known(means.air_temperature),
        "material_temperature_degC": _known(means.material_temperature),
        "material_temperature_range_K": float(np.ptp(material)) if material.size else None,
        "air_pressure_Pa": _known(means.air_pressure),
        "relative_humidity": _known(means.relative_humidity),
    }


def _known(value: float) -> float | None:
    return float(value) if isfinite(value) else None


def _time(nanoseconds: int) -> datetime | None:
    if nanoseconds * 1e-9 <= ANY_DATE:
        return None
    return _EPOCH + timedelta(microseconds=nanoseconds // 1000)
