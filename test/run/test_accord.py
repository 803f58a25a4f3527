"""A run is refused whose nodes are not about one and the same machine."""

import pytest

from stepdiag_ros.run.accord import DRIVER, MACHINE, discords, machine_fact
from stepdiag_ros.run.supervision import Peer, Watch

OURS, OTHER = machine_fact("gantry", "name: gantry"), machine_fact("demo", "name: demo")


def watch(**drivers):
    made = Watch()
    for role, driver in drivers.items():
        facts = {DRIVER: driver} | ({MACHINE: OURS} if role == "cnc_bridge" else {})
        made.heard(role, Peer(role, 0.0, role, "", facts=facts))
    return made


@pytest.mark.parametrize(
    ("drivers", "cell", "about"),
    [
        (
            {"cnc_bridge": "grbl", "interferometer": "ids3010", "weather": "line_protocol"},
            False,
            [],
        ),
        ({"cnc_bridge": "simulated", "interferometer": "simulated"}, False, []),
        ({"cnc_bridge": "simulated", "interferometer": "ids3010"}, False, []),
        ({"cnc_bridge": "grbl", "interferometer": "simulated"}, True, []),
        ({"cnc_bridge": "grbl", "interferometer": "simulated"}, False, ["interferometer"]),
        (
            {"cnc_bridge": "grbl", "interferometer": "simulated", "weather": "simulated"},
            False,
            ["interferometer", "weather"],
        ),
        ({"interferometer": "simulated"}, False, []),
    ],
)
def test_a_simulated_sensor_of_a_real_machine_is_refused(drivers, cell, about):
    found = discords(watch(**drivers), OURS, cell)
    assert len(found) == len(about)
    for sentence, role in zip(found, about, strict=True):
        assert role in sentence and "grbl" in sentence


def test_another_machine_at_the_bridge_is_refused_and_both_are_named():
    nodes = watch(cnc_bridge="simulated", interferometer="simulated")
    assert discords(nodes, OURS, cell=True) == []
    (sentence,) = discords(nodes, OTHER, cell=True)
    assert OURS in sentence and OTHER in sentence and "machine" in sentence


def test_the_same_name_with_another_file_is_another_machine():
    assert machine_fact("gantry", "travel: 1") != machine_fact("gantry", "travel: 2")


def test_a_bridge_that_is_gone_does_not_count():
    nodes = watch(cnc_bridge="grbl", interferometer="simulated")
    nodes.check(0.0)
    for second in range(1, 20):
        nodes.check(0.4 * second)
    assert "cnc_bridge" in nodes.lost
    assert discords(nodes, OTHER, cell=False) == []
