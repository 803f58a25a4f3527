"""The uncertainty of nodes on the fly that a plan expects, against that of passes."""

from dataclasses import replace

import numpy as np
import pytest
from moving_machine import DIAGONAL, FAST, LINES, VOLUME, MovingMachine, Worst

from stepdiag_ros.metrology.geometry import beam_direction
from stepdiag_ros.metrology.on_the_fly.evaluate import evaluate_pass
from stepdiag_ros.metrology.on_the_fly.expected import Pace, Streams, expected_covariance

STREAMS = Streams(reading_noise=0.01e-6)


def test_what_is_expected_of_nodes_is_what_worst_machines_show():
    ratios = []
    for seed in range(8):
        worst = (Worst(), FAST)[seed % 2]
        machine = MovingMachine(seed, LINES[seed // 2 % 2], worst)
        # These machines stand in a corner from 0.02 s to 0.03 s after a way back of 0.065 s.
        pace = Pace(worst.feed, 2.0, 0.09, lag=0.01)
        streams = Streams(1000.0, 1000.0, worst.noise / np.sqrt(1000.0), worst.jitter)
        told = expected_covariance(machine.targets, machine.direction, pace, streams)
        found = evaluate_pass(machine.record()).covariance
        ratios.append(np.sqrt(np.trace(found) / np.trace(told)))
    assert 0.9 < np.median(ratios) < 1.1 and min(ratios) > 0.75 and max(ratios) < 1.3


@pytest.mark.parametrize(
    ("worse", "better"),
    [
        ({"reading_noise": 0.05e-6}, {}),
        ({"reading_rate": 250.0, "stamp_jitter": 50e-6}, {"stamp_jitter": 50e-6}),
        ({"stamp_jitter": 100e-6}, {}),
    ],
)
def test_nodes_are_more_uncertain_by_noise_and_jitter_and_with_fewer_readings(worse, better):
    targets = DIAGONAL.stops(VOLUME)
    beam = beam_direction("ppp", np.asarray(VOLUME.step))
    bad, good = (
        np.trace(expected_covariance(targets, beam, Pace(0.05, 2.0, 0.1), replace(STREAMS, **one)))
        for one in (worse, better)
    )
    assert bad > 1.02 * good
