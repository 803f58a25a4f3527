"""What a run with faults must have been: judged from bags, and from what the device has done."""

import tempfile
from pathlib import Path

import numpy as np

from stepdiag_ros import topics
from stepdiag_ros.bags.folder import open_bag
from stepdiag_ros.bags.reader import BagReader
from stepdiag_ros.bags.recover import recover
from stepdiag_ros.bags.run import load_run
from stepdiag_ros.configuration import load_cell
from stepdiag_ros.metrology.plan import FORWARD
from stepdiag_ros.run.sequence import Answer

TOLERANCE = 1e-6
"""m by which a published displacement may differ from the truth, beside five times its own standard
uncertainty: the window in which an axis is in position, and what the sensors miss of the air."""


def whole(bag, closed):
    """Return the readable bag: itself, or what could be recovered of it.

    Raises:
        ValueError: it is not whole; every record is read and its checksum compared.
    """
    if not closed:
        target = Path(tempfile.mkdtemp(dir=bag.parent)) / bag.name
        recover(bag, target)
        bag = target
    with BagReader(bag) as reader:
        if not sum(1 for _ in reader.records()):
            raise ValueError(f"{bag}: holds nothing")
    return bag


def wrong_lines(bag, cell_name):
    """Return sentences on published lines whose displacements are not those of the simulated cell.

    Compared are differences to the line's first settled stop, in the alignment of the line's setup.
    """
    run, cell = load_run(bag), load_cell(cell_name)[0]
    said = []
    for line in run.lines:
        setup = line.setup.split(" (zero")[0]
        forward = type(line.line)(**{**vars(line.line), "direction": FORWARD})
        start = forward.stops(run.volume)[0]
        alignment = cell.alignment(setup, line.line.name, run.volume.step, tuple(start))
        places = {
            stop.command.stop: stop.position
            for stop in run.stops
            if stop.settled
            and (stop.command.line_index, stop.command.attempt) == (line.line_index, line.attempt)
        }
        known = [n for n in np.flatnonzero(np.isfinite(line.displacement)).tolist() if n in places]
        if len(known) < 2:
            continue
        truth = cell.displacement(np.array([places[number] for number in known]), alignment)
        worst = beyond(line.displacement[known], truth, line.standard_uncertainty[known])
        if worst is not None:
            said.append(
                f"{line.line}, attempt {line.attempt}, stop {known[worst[0]]}: published with "
                f"{worst[1] * 1e6:.3g} µm more than the truth"
            )
    return said


def beyond(found, truth, uncertainty):
    """Return which stop is farthest beyond what noise allows, and by how much it is off, m.

    None if no stop is. Compared are differences to the first stop.
    """
    off = (found - found[0]) - (truth - truth[0])
    allowed = TOLERANCE + 5.0 * (uncertainty + uncertainty[0])
    worst = int(np.argmax(np.abs(off) - allowed))
    return (worst, float(off[worst])) if abs(off[worst]) > allowed[worst] else None


def doubled(bag):
    """Return sentences on commands of which a bag tells that they were executed more than once."""
    accepted = {}
    name = topics.absolute(topics.COMMAND_STATUS)
    with open_bag(bag) as opened:
        for record in opened.records(topics=[name]):
            message = opened.types.decode(topics.COMMAND_STATUS.type_name, record.data)
            if message.status == Answer.ACCEPTED:
                key = (message.run_id, int(message.command_id))
                accepted[key] = accepted.get(key, 0) + 1
    return [
        f"command {key[1]} of run {key[0]} was executed {n} times"
        for key, n in accepted.items()
        if n > 1
    ]


class DeviceLog:
    """What the device itself has done (written by ``faulty_devices.FaultyCnc``)."""

    def __init__(self, file):
        self._file = Path(file)

    def entries(self):
        """Return times (s of the monotonic clock) and what happened, in order."""
        if not self._file.exists():
            return []
        rows = (line.split(" ", 1) for line in self._file.read_text().splitlines() if " " in line)
        return [(float(time), what) for time, what in rows]

    def moves_at(self, when):
        """Say whether the device was in a move at a time."""
        moving = False
        for time, what in self.entries():
            if time > when:
                break
            if what == "MOVING":
                moving = True
            elif what in ("READY", "STOPPED", "FAULT"):
                moving = False
        return moving

    def rests_after(self, when):
        """Return when after a time a move that went on then has ended; None if it has not."""
        for time, what in self.entries():
            if time > when and what in ("READY", "STOPPED", "FAULT"):
                return time
        return None

    def starts_between(self, begin, end):
        """Return how many moves were begun between two times."""
        return sum(1 for time, what in self.entries() if begin < time < end and "start" in what)
