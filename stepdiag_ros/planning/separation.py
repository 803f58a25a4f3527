"""The extra plan for what a diagnosis left open: under the run's own conditions, with its file."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from threadpoolctl import ThreadpoolController

from stepdiag_ros.metrology.discrepancy.findings import Diagnosis
from stepdiag_ros.metrology.discrepancy.proposal import ExtraPlan, propose
from stepdiag_ros.metrology.effects.effect import ActiveEffect, Effect
from stepdiag_ros.metrology.machine import Machine
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.planning.duration import Assumptions, duration
from stepdiag_ros.planning.plan_text import plan_text
from stepdiag_ros.planning.request import sampling_with

_FEED = 0.033
"""Of moves where times do not show it, m/s; as of ``planning.proposal.Request``."""
_DWELL = 1.0
_ACCELERATION = 1.0
_LEAST_DWELL = 0.05
_SHOWN = 1e-3
"""Part of a stop's time by which longer moves must take longer for these to show the feed."""


def conditions_of(measurement: Measurement) -> Plan:
    """Return a plan without lines that has the box of a run, and feed and dwell by its times.

    The time from stop to stop is way over feed plus dwell. Where all ways are of one length, or
    all take as long, feed is taken to be 33 mm/s.
    """
    ways, times = [np.zeros(0)], [np.zeros(0)]
    for line in measurement.lines:
        ways.append(np.linalg.norm(np.diff(line.target, axis=0), axis=1))
        times.append(np.diff(line.time))
    way, time = np.concatenate(ways), np.concatenate(times)
    real = np.isfinite(time) & (time > 0.0)
    way, time = way[real], time[real]
    feed, dwell = _FEED, _DWELL
    if len(time):
        if np.ptp(way) > 0.05 * np.max(way):
            slope, offset = np.linalg.lstsq(
                np.column_stack([way, np.ones_like(way)]), time, rcond=None
            )[0]
            # Where all moves take as long, only rounding says how fast they were.
            if slope * np.ptp(way) > _SHOWN * offset > 0.0:
                feed, dwell = float(1.0 / slope), float(offset)
            else:
                dwell = float(np.median(time - way / feed))
        else:
            dwell = float(np.median(time - way / feed))
    # What people write into a plan, not all the digits of a mean.
    sampling = sampling_with(float(f"{max(dwell, _LEAST_DWELL):.2g}"))
    return Plan("conditions of a run", measurement.volume, (), float(f"{feed:.2g}"), sampling)


def propose_extra(
    measurement: Measurement,
    diagnosis: Diagnosis,
    conditions: Plan | None = None,
    machine: Machine | None = None,
    known: Sequence[ActiveEffect] = (),
    catalogue: Iterable[Effect] | None = None,
    fitted: Sequence[ActiveEffect] = (),
    curves: Mapping[str, Sequence[float]] | None = None,
) -> ExtraPlan:
    """Seek the quickest extra plan for what a diagnosis left open.

    Args:
        measurement: the runs so far.
        diagnosis: of them.
        conditions: feed and sampling of the run; by its times if None or if its feed is not known.
        machine: its acceleration; 1 m/s² if None.
        known: as given to ``diagnose``, like the following.
        catalogue: effects that were tried; all that are installed if None.
        fitted: effects of the model whose sizes are free.
        curves: that the model has fixed.
    """
    basis = conditions
    if basis is None or not basis.feed > 0.0:
        basis = conditions_of(measurement)
    box = measurement.volume
    drives = machine or Machine(
        "unknown",
        measurement.chain,
        tuple(box.nodes(axis)[0] for axis in range(3)),
        tuple(box.nodes(axis)[-1] for axis in range(3)),
        max(basis.feed, 1e-6),
        _ACCELERATION,
    )
    assumptions = Assumptions()
    # One thread is the fastest for these matrices.
    with ThreadpoolController().limit(limits=1, user_api="blas"):
        return propose(
            measurement,
            diagnosis,
            replace(basis, overrun=0.0),
            lambda plan: duration(plan, drives, assumptions).total,
            known,
            catalogue,
            fitted,
            curves,
        )


def proposal_text(proposal: ExtraPlan, source: str = "") -> str:
    """Return the YAML of the proposed plan, with why it is as it is.

    Args:
        proposal: with a plan.
        source: names of the runs that it is for; empty if they have none.

    Raises:
        ValueError: there is no plan.
    """
    if proposal.plan is None:
        raise Refusal(proposal.sentence, fault="too_few")
    comments = [
        f"Extra lines for {source or 'a run'}, by stepdiag diagnose --propose.",
        *(f"To be distinguished: {', '.join(group)}." for group in proposal.rivals),
        proposal.sentence,
        *proposal.conditions,
        *(one.why for one in proposal.left_open),
        f"Afterwards: stepdiag diagnose {source or 'RUN'} EXTRA, with the new run as EXTRA.",
    ]
    return plan_text(proposal.plan, comments)
