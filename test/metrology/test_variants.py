"""What is none of the catalogue's shapes, but a near miss, is not given the catalogue's names."""

import numpy as np
import pytest
from hidden_runs import hidden_run

from stepdiag_ros.metrology.discrepancy import AMBIGUOUS, DESCRIBED, NAMED, diagnose
from stepdiag_ros.metrology.effects.backlash import EFFECT as BACKLASH
from stepdiag_ros.metrology.effects.drift import EFFECT as DRIFT
from stepdiag_ros.metrology.effects.effect import ActiveEffect
from stepdiag_ros.metrology.effects.sag import EFFECT as SAG

CATALOGUE = (BACKLASH, DRIFT, SAG)


def sag(error, over, size):
    return ActiveEffect(SAG, {"error": error, "over": over}, {"corner": size})


def three_axes(stops):
    """Return the change of the readings by a sag with the product of all three positions."""
    return 1.5e-6 * stops.direction[:, 2] * np.prod(stops.share, axis=1)


def growing_backlash(stops):
    return 0.5e-6 * stops.direction[:, 0] * stops.last_sense[:, 0] * stops.share[:, 1]


def faster_and_faster(stops):
    return 5e-6 * stops.direction[:, 1] * (stops.time / stops.duration) ** 2


@pytest.mark.parametrize(
    ("shape", "nearest", "drivers"),
    [
        (three_axes, "sag along Z", {"the place of X", "the place of Y", "the place of Z"}),
        (faster_and_faster, "drift along Y", {"time"}),
        (growing_backlash, "backlash of X", {"the place of Y", "the sense of X's last move"}),
    ],
)
def test_a_near_miss_is_described_and_not_named(shape, nearest, drivers):
    diagnosis = diagnose(hidden_run(shape=shape), catalogue=CATALOGUE)
    assert diagnosis.verdict == DESCRIBED, diagnosis.sentence
    (dependence,) = diagnosis.description.dependences
    assert {*dependence.drivers} == drivers
    assert diagnosis.description.nearest.startswith(nearest)
    assert 0.0 < diagnosis.description.nearest_share < 0.95


@pytest.mark.parametrize(
    "effects",
    [
        (sag("Z", "XY", 1.5e-6),),
        (sag("Z", "XY", 1.5e-6), sag("Z", "XZ", -1.5e-6)),
        (
            ActiveEffect(BACKLASH, {"axis": "X"}, {"lost_motion": 0.5e-6}),
            ActiveEffect(DRIFT, {"along": "Y"}, {"m_per_s": 5e-9}),
        ),
    ],
)
def test_the_catalogue_s_own_shapes_are_named(effects):
    diagnosis = diagnose(hidden_run(*effects, seed=7), catalogue=CATALOGUE)
    # Some sags cannot be told from others in this run, but none is a variant of another.
    assert diagnosis.verdict in (NAMED, AMBIGUOUS), diagnosis.sentence
    named = {label for one in diagnosis.findings for label in (one.label, *one.ambiguous)}
    assert {effect.effect.label(effect.setting) for effect in effects} <= named
    assert len(diagnosis.findings) == len(effects)
