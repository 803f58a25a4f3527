"""A whole measurement by the nodes on a controller that is a peer in this process.

The machine is an imperfect twin that only the laser sees: it stands where the controller says that
the axes are, and errs by known errors. On the way something breaks; somebody mends it, and resumes.
"""

import time
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import yaml
from domains import own_domain, room_for_a_cell

from stepdiag_ros import topics
from stepdiag_ros.bags.reader import BagReader
from stepdiag_ros.configuration import cell_from_text
from stepdiag_ros.evaluation.recorded_run import measurement_of
from stepdiag_ros.evaluation.report import same_to_the_last_bit
from stepdiag_ros.evaluation.solving import solve_reproducibly
from stepdiag_ros.metrology.simulation import read_again
from stepdiag_ros.processes.cell import twin_cell
from stepdiag_ros.processes.following import FollowedRun, RunFailed
from stepdiag_ros.processes.graph import in_graph
from stepdiag_ros.processes.node_process import Processes
from stepdiag_ros.run.sequence import Answer, State

PLAN = """\
name: small cube, in a quarter of a minute of real time
step_m: [0.004, 0.004, 0.004]
blocks: 3
repeats: 1
directions: [forward]
feed_m_per_s: 0.1
pause_for_setup: false
lines:
  - kind: linear
    names: [x, y, z]
  - kind: step_diagonal
    names: [ppp, npp, pnp]
    orders: [XYZ]
sampling:
  dwell_s: 0.13
  settle_s: 0.04
  window_s: 0.08
"""
CELL = """\
name: large errors on a small way
seed: 11
chain: YXZ
errors:
  travel_low_m: [0.0, 0.0, 0.0]
  travel_high_m: [0.012, 0.012, 0.012]
  positioning_m: 1.0e-6
  straightness_m: 0.7e-6
  squareness_rad: {C0Y: 200.0e-6, B0Z: -150.0e-6, A0Z: 250.0e-6}
misalignment: {beam_sigma_rad: 300.0e-6, mirror_sigma_rad: 50.0e-6}
reading_noise_m: 0.05e-6
reading_rate_hz: 200.0
"""
PATIENCE = {
    "bridge": {
        "retry_after": 0.5,
        # A computer that is busy with all nodes at once is no danger to this machine.
        "silence_limit": 5.0,
        "position_timeout": 10.0,
    },
    # The twin reads nothing while nobody tells it where it stands; a laser would.
    "interferometer": {"reading_timeout": 10.0},
    "assembler": {"reading_timeout": 10.0},
    "recorder": {"reading_timeout": 10.0, "position_timeout": 10.0},
}
"""Node → parameters of which it gets others than in a cell."""
UP, MENDED, ASKED = 300.0, 300.0, 3.0
"""s in which all nodes are up, in which what was mended works again, and between two requests to
go on."""
SILENT = "is silent for"
"""What a run says that is held because a node was not heard."""
LEAST_MOVES = 36
"""From stop to stop in the whole plan; beside them the machine travels from line to line."""


class PeerRun:
    """One run of the plan; whenever it is held, what is broken is mended and the run resumed.

    A node that this computer was too busy for is no fault of the controller: nothing is mended.

    Args:
        folder: bag and logs go there.
        driver: of the controller.
        settings: of the driver.
        mend: is called once in each hold, before the controller is waited for.
        peer: context in which a controller is there that itself is in the ROS graph.

    Attributes:
        held: state and words of each hold in which something was mended.
        resumed: how often the run was held, for whatever reason.
        bag: of the run.
    """

    def __init__(self, folder, driver, settings, mend, peer=None):
        self.held, self.resumed, self._mend, self._refusal = [], 0, mend, ""
        files = {"plan": PLAN, "cell": CELL, "device": yaml.safe_dump(settings)}
        for name, text in files.items():
            (folder / f"{name}.yaml").write_text(text)
        plan, cell, device = (str(folder / f"{name}.yaml") for name in files)
        nodes = [
            replace(node, parameters=node.parameters | PATIENCE.get(node.name, {}))
            for node in twin_cell(plan, "demo", cell, folder, driver, device)
        ]
        with (
            room_for_a_cell(),
            own_domain(),
            peer or nullcontext(),
            in_graph(),
            Processes(nodes, folder / "logs") as processes,
        ):
            self._follow(processes, len(nodes))

    def _follow(self, processes, count):
        from stepdiag_ros.nodes.operator import OperatorNode

        self._operator = OperatorNode()
        peers = self._operator.watch.peers
        assert self._operator.spin_until(
            lambda: len(peers) == count and not any(peer.faulty for peer in peers.values()), UP
        ), {peer.role: peer.text for peer in peers.values()}

        def check():
            assert not processes.ended(), processes.ended()

        self.bag = self._measure(check)

    def _measure(self, check):
        deadline = time.monotonic() + UP
        while True:
            run = FollowedRun(self._operator, lambda _: None, check, self._on_hold)
            try:
                return run.measure().bag
            except RunFailed:
                # Refused as long as the twin waits for a controller that is slow to answer.
                if run.run_id or time.monotonic() > deadline:
                    raise

    def _on_hold(self, state, text):
        self.resumed += 1
        if SILENT not in text:
            self.held.append((state, text))
            self._mend()
        deadline = time.monotonic() + MENDED
        # Again, as an operator would, until the bridge has its controller and the run goes on.
        while self._operator.state.state == state:
            if time.monotonic() > deadline:
                raise RunFailed(f"it cannot be resumed: {self._refusal or text}")
            self._resume()
        return False

    def _resume(self):
        try:
            self._operator.call("sequencer/resume")
            self._refusal = ""
        except ValueError as error:
            self._refusal = str(error)
        waited = 0.2 if self._refusal else ASKED
        self._operator.spin_until(lambda: self._operator.state.state == State.RUNNING, waited)


def commands_of(bag):
    """Return the targets, m, of the commands that the bridge has accepted, in their order.

    Those that move no axis are left out: no controller hears of them.
    """
    return [target for _, target in numbered_commands_of(bag)]


def numbered_commands_of(bag):
    """Return the number beside each target of ``commands_of``."""
    targets = {}
    with BagReader(bag) as reader:
        for record, message in reader.messages():
            if record.topic == topics.absolute(topics.MACHINE_COMMAND):
                targets[message.command_id] = tuple(message.target) if message.axis else None
    accepted = [number for number, _ in answers_of(bag, Answer.ACCEPTED)]
    assert len(accepted) == len(set(accepted))
    return [(number, targets[number]) for number in accepted if targets[number]]


def positions_of(bag):
    """Return target and actual position, m, of each settled stop, in the order of time."""
    with BagReader(bag) as reader:
        return [
            (tuple(message.target), tuple(message.position))
            for record, message in reader.messages()
            if record.topic == topics.absolute(topics.STOP) and message.settled
        ]


def answers_of(bag, answer):
    """Return number and words of each command that was answered in one way."""
    with BagReader(bag) as reader:
        return [
            (message.command_id, message.reason)
            for record, message in reader.messages()
            if record.topic == topics.absolute(topics.COMMAND_STATUS) and message.status == answer
        ]


def check_commands(bag, done):
    """Compare what was commanded with what the controller has done: targets in mm, in order."""
    targets = 1e3 * np.array(commands_of(bag))
    assert np.shape(done) == targets.shape and len(targets) > LEAST_MOVES
    assert np.abs(np.array(done) - targets).max() < 1e-4


def check_displacements(recorded):
    """Compare the lines with what the twin would show without noise, by their uncertainty."""
    cell = cell_from_text(recorded.cell_text, "cell of the run")
    measured = recorded.measurement
    true = read_again(measured, cell)
    shares = []
    for line, exact in zip(measured.lines, true.lines, strict=True):
        # The noise of the first stop is the zero of all: counted from their weighted mean, the
        # readings are nearly independent.
        weight = 1.0 / line.standard_uncertainty**2
        off = line.displacement - exact.displacement
        off -= np.average(off, weights=weight)
        left = np.sqrt(1.0 / weight - 1.0 / np.sum(weight))
        shares.append(off / left)
        assert np.ptp(line.displacement) > 10e-3
    shares = np.concatenate(shares)
    rms, coverage = float(np.sqrt(np.mean(shares**2))), float(np.mean(np.abs(shares) < 2.0))
    noise = np.concatenate([line.standard_uncertainty for line in measured.lines])
    print(
        f"{len(shares)} stops, standard uncertainty {np.mean(noise) * 1e9:.2g} nm: off by"
        f" {rms:.2f} of it rms, {coverage:.0%} within twice, {np.abs(shares).max():.1f} at most"
    )
    assert len(shares) == recorded.plan.stop_count
    assert 1e-9 < noise.min() <= noise.max() < 50e-9
    # Each uncertainty is that of sixteen readings: far values are those of Student's t.
    assert 0.6 < rms < 1.6 and coverage > 0.8 and np.abs(shares).max() < 6.0


def check_result(recorded):
    """Solve the bag anew: the same as live to the last bit, and the errors of the twin."""
    measurement, remark = measurement_of(recorded, False, lambda *_: None)
    assert "bit-identical to the recorded ones" in remark
    results, _ = solve_reproducibly(measurement)
    last = {result.method: result for result in recorded.results}
    assert set(results) == set(last) >= {"setup_robust", "least_squares"}
    for method, result in results.items():
        assert same_to_the_last_bit(result, last[method]), method
    cell = cell_from_text(recorded.cell_text, "cell of the run")
    truth, found = cell.truth(recorded.volume), results["least_squares"]
    for name, values in found.curves.items():
        off = np.abs(values - truth[name])
        assert np.nanmax(off - 5.0 * found.standard_uncertainty[name]) < 1e-9, name
    # A solver that says zero would not pass.
    assert max(np.ptp(truth[name]) for name in found.curves) > 2e-6
