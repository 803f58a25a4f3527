"""A dozen random faults of a fixed seed in runs of the simulated cell; all of them are borne.

``benchmarks/fault_campaign.py`` does the same with any number of faults, and on LinuxCNC.
"""

import os
import sys
from pathlib import Path

import numpy as np
import pytest
from refused import refused

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
SEED, DOZEN = 20261121, 12


@pytest.fixture
def campaign(monkeypatch):
    monkeypatch.setenv("PYTHONPATH", os.environ.get("PYTHONPATH", ""))
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    import fault_campaign

    return fault_campaign


def test_a_dozen_faults_are_borne(campaign, tmp_path):
    with campaign.Cell(tmp_path, factor=20.0) as cell:
        found = campaign.campaign(cell, SEED, range(DOZEN), lambda _: None, in_a_run=DOZEN)
    assert [one["number"] for one in found] == list(range(DOZEN))
    assert {one["number"]: one["complaints"] for one in found if one["complaints"]} == {}
    assert any(one["resumed"] for one in found), "not one of the faults has held a run"
    assert len({(one["where"], one["kind"]) for one in found}) >= 8


def test_faults_are_the_same_for_the_same_seed(campaign):
    assert campaign.draw(1, 7) == campaign.draw(1, 7) != campaign.draw(2, 7)
    kinds = {(campaign.draw(1, n)["where"], campaign.draw(1, n)["kind"]) for n in range(200)}
    wanted = {("laser", kind) for kind in campaign.LASER} | {("cnc", kind) for kind in campaign.CNC}
    wanted |= {("kill", node) for node in campaign.KILLED}
    wanted |= {("halt", node) for node in campaign.HALTED}
    assert kinds == wanted


def test_the_judge_finds_what_is_wrong(campaign, tmp_path):
    """A stop 3 µm off, a bag whose checksum does not hold, a machine that moves."""
    fault_judging = sys.modules[campaign.whole.__module__]

    from stepdiag_ros.bags.run import load_run

    bag = Path(__file__).parents[1] / "data" / "bags" / "schema_1.mcap"
    assert load_run(bag).run_id
    damaged = tmp_path / "damaged.mcap"
    data = bytearray(bag.read_bytes())
    data[len(data) // 2] ^= 1
    damaged.write_bytes(data)
    with refused(Exception, None, "damaged.mcap"):
        fault_judging.whole(damaged, closed=True)
    assert fault_judging.whole(bag, closed=True) == bag

    log = tmp_path / "device.log"
    log.write_text("1.0 start 0 0 0\n1.1 MOVING\n2.0 stop\n2.1 STOPPED\n")
    told = fault_judging.DeviceLog(log)
    assert [told.moves_at(when) for when in (1.05, 1.5, 2.05, 2.2)] == [False, True, True, False]
    assert told.rests_after(1.5) == 2.1 and told.rests_after(2.2) is None
    assert told.starts_between(0.0, 3.0) == 1 and told.starts_between(1.5, 3.0) == 0
    off = np.array([0.0, 3e-6])
    assert fault_judging.beyond(off, np.zeros(2), np.full(2, 1e-8)) == (1, pytest.approx(3e-6))
    assert fault_judging.beyond(off * 0.1, np.zeros(2), np.full(2, 1e-8)) is None
