"""An interferometer at 5 kHz on live nodes, its clock late: nothing is lost, and it is found."""

import pytest

from stepdiag_ros.bags.info import bag_info
from stepdiag_ros.bags.reader import BagReader
from stepdiag_ros.bags.run import load_run
from stepdiag_ros.metrology.assembly import assemble
from stepdiag_ros.metrology.measurement import MeasuredLine
from stepdiag_ros.run.sequence import State
from stepdiag_ros.run.timing import in_words

LATE = 0.0125
"""s: the time on the way and the offset of the clock, together."""


def told_live(path):
    """Return what the assembler last said on /diagnostics, µs."""
    told = []
    with BagReader(path) as bag:
        for _, array in bag.messages(topics={"/diagnostics"}):
            for status in array.status:
                if status.name == "assembler: timing":
                    told.append({entry.key: entry.value for entry in status.values})
    return float(told[-1]["readings stamped late by (µs)"])


def test_a_fast_instrument_with_a_late_clock(make_cell):
    made = make_cell(rate=5000.0, tick=0.004)
    made.nodes["interferometer"].parameters["device_file"] = "late_clock"
    with made as cell:
        cell.start()
        cell.wait_for_state(State.FINISHED)
        cell.wait(cell.bag_is_closed, "the bag is closed")
    (path,) = cell.folder.glob("*.mcap")
    assert told_live(path) == pytest.approx(LATE * 1e6, abs=50.0)
    info = bag_info(path)
    check = info.samples["/"]
    assert (check.missing, check.different, info.gaps) == (0, 0, [])
    assert check.rate == pytest.approx(5000.0)
    assert check.samples > 5 * check.made > 5 * 30_000
    assert info.timing.offset.offset == pytest.approx(LATE, abs=5e-5)
    assert abs(info.timing.offset.offset - LATE) < 3.0 * info.timing.offset.expanded_uncertainty
    assert "µs late ±" in in_words(info.timing)
    run = load_run(path)
    assert len(run.lines) == 6 and all(line.complete for line in run.lines)
    events = assemble(run.plan, run.start_time, run.commands, run.arrivals, run.readings())
    again = [event for event in events if isinstance(event, MeasuredLine)]
    assert [a.displacement.tolist() for a in again] == [b.displacement.tolist() for b in run.lines]
