"""Settled stops found by stillness beside those of the same readings with every command known."""

import numpy as np
from program_run import Instrument, run_program

from stepdiag_ros.metrology.assembly import assemble
from stepdiag_ros.metrology.by_hand import Numbering, as_commanded, find_stops, plan_by_hand
from stepdiag_ros.metrology.measurement import Arrival, SettledStop, StopCommand
from stepdiag_ros.planning.moves import moves_of

SETTLED = 50_000_000
"""ns after the end of its command after which a controller says in position."""


def stops_by_hand(plan, readings):
    """Return (line, stop) → settled stop, as found in the readings alone."""
    found = find_stops(plan, range(len(plan.lines)), readings)
    hand = plan_by_hand(plan)
    commands, arrivals = as_commanded(hand, found, 0, Numbering())
    return _by_place(assemble(hand, readings[0].time, commands, arrivals, readings))


def stops_commanded(plan, seen, work):
    """Return (line, stop) → settled stop, with the commands known that really were.

    Args:
        plan: of the run.
        seen: the recording.
        work: s that the operator is at work before the first stop of a setup is read.
    """
    labels = [
        (index, stop)
        for index, line in enumerate(plan.lines)
        for stop in range(len(line.stops(plan.volume)))
    ]
    moves = [number for number, move in enumerate(moves_of(plan)) if move.dwell_s > 0.0]
    commands, arrivals = [], []
    for number, ((index, stop), move) in enumerate(zip(labels, moves, strict=True)):
        line = plan.lines[index]
        target = tuple(line.stops(plan.volume)[stop].tolist())
        waits = round(2e9 * work) if moves_of(plan)[move].program_stop else 0
        time = seen.arrivals[move] + SETTLED + waits
        left = time - SETTLED - 1
        commands.append(StopCommand(number, index, 1, plan.setup_of(line), stop, "", target, left))
        arrivals.append(Arrival(number, time, target))
    return _by_place(assemble(plan, 0, commands, arrivals, seen.readings))


def compared(plan, cell, rate, seed=1, work=5.0):
    """Return differences of settled stops, m, and the standard uncertainties of these, m."""
    instrument = Instrument(rate=rate, seed=seed, work=work)
    seen = run_program(plan, moves_of(plan), cell, 2.0, instrument)
    known, mine = stops_commanded(plan, seen, work), stops_by_hand(plan, seen.readings)
    assert set(known) == set(mine)
    both = [(mine[place], known[place]) for place in known]
    assert all(one.settled and other.settled for one, other in both)
    return (
        np.array([one.displacement - other.displacement for one, other in both]),
        np.array(
            [np.hypot(one.standard_uncertainty, other.standard_uncertainty) for one, other in both]
        ),
    )


def _by_place(events):
    return {
        (event.command.line_index, event.command.stop): event
        for event in events
        if isinstance(event, SettledStop)
    }
