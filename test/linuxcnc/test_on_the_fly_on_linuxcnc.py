"""Lines on the fly on a real LinuxCNC, whose own trajectory planner makes the moves."""

from pathlib import Path

import pytest
from patience import PATIENCE

from stepdiag_ros.bags.run import load_run
from stepdiag_ros.evaluation.flown import flown_run
from stepdiag_ros.processes.cell import twin_cell
from stepdiag_ros.processes.measure import MeasuringSession

pytestmark = pytest.mark.timeout(2 * PATIENCE)
PLAN = """
name: on the fly on LinuxCNC
step_m: [0.01, 0.01, 0.01]
blocks: 4
directions: [forward, backward]
feed_m_per_s: 0.04
pause_for_setup: false
measurement: on_the_fly
lines:
  - {kind: linear, names: [x]}
  - {kind: step_diagonal, names: [ppp]}
sampling: {dwell_s: 0.3, settle_s: 0.1, window_s: 0.2, line_attempts: 5}
"""
LATE = 0.0125
"""s, of ``late_clock``: the time on the way and the offset of the clock, together."""


@pytest.fixture(scope="module")
def run(make_instance, tmp_path_factory):
    instance = make_instance()
    folder: Path = tmp_path_factory.mktemp("run")
    plan, device = folder / "plan.yaml", folder / "linuxcnc.yaml"
    plan.write_text(PLAN)
    # A busy computer is no dead controller.
    device.write_text(f"socket: {instance.socket}\ndead_man_s: 2.0\nsilence_s: 20.0\n")
    nodes = twin_cell(str(plan), "demo", "moving", folder, "linuxcnc", str(device))
    for node in nodes:
        if node.name == "bridge":
            node.parameters["position_rate"] = 200.0
        if node.name == "interferometer":
            node.parameters.update(rate=1000.0, device_file="late_clock")
    found = load_run(MeasuringSession(nodes, folder, lambda _: None).measure())
    instance.stop()
    return found


def test_all_lines_are_measured(run):
    lines = run.measurement.lines
    assert [line.complete for line in lines] == [True] * 4
    assert max(float(line.standard_uncertainty.max()) for line in lines) < 0.1e-6


def test_the_delay_is_found(run):
    flown = flown_run(run)
    assert {delay.axis for delay in flown.delays} == set("XYZ")
    for delay in flown.delays:
        assert abs(delay.delay - LATE) <= 2.0 * delay.standard_uncertainty
        assert delay.standard_uncertainty < 50e-6
