"""What becomes of an effect, in a sentence: the numbers of the runs and the figures with units."""

import numpy as np
import pytest

from stepdiag_ros.metrology.discrepancy.course import SizesInRun, course_of
from stepdiag_ros.metrology.discrepancy.findings import Candidate
from stepdiag_ros.metrology.discrepancy.history import EffectHistory
from stepdiag_ros.metrology.effects.backlash import EFFECT
from stepdiag_ros.words.history import effect_sentence, runs_words

MICRON = 1e-6


def history(sizes, rivals=()):
    """A backlash of these sizes, µm, each with a standard uncertainty of 0.05 µm."""
    information = np.eye(1) / (0.05 * MICRON) ** 2
    nothing = SizesInRun(np.zeros((1, 1)), np.zeros(1), 100.0)
    runs = [
        nothing if size is None else SizesInRun(information, information[0] * size * MICRON, 1e6)
        for size in sizes
    ]
    course = course_of(runs, np.arange(float(len(runs))), np.ones(1))
    candidate = Candidate(EFFECT, {"axis": "X"}, "backlash of X")
    return EffectHistory("backlash of X", (candidate,), EFFECT.sizes[0], course, rivals, (0,))


@pytest.mark.parametrize(
    ("sizes", "parts"),
    [
        ((1.0, 1.0, None, 1.0), ("1.000 ± 0.057 µm", "Run 3 could not show it")),
        ((0.0, 1.0, 2.0, 3.0), ("1.000 ± 0.044 µm per month",)),
        ((0.0, 1.0, 0.0, 1.0), ("runs 2 and 4 (1.000 ± 0.069 µm)", "runs 1 and 3")),
        ((0.0, 1.0, 0.0, 2.0, 0.0), ("runs 2 and 4 (in different sizes)", "runs 1, 3 and 5")),
        ((1.0, 2.0), ("Two runs do not show",)),
        ((1.0, None), ("only run 1 shows it",)),
    ],
)
def test_a_sentence_has_the_runs_and_the_figure(sizes, parts):
    said = effect_sentence(history(sizes))
    assert all(part in said for part in parts), said


def test_only_some_of_many_rivals_are_listed():
    said = effect_sentence(history((1.0, 1.0), tuple(f"rival {n}" for n in range(7))))
    assert "rival 3" in said and "rival 4" not in said and "3 more" in said


def test_runs_are_counted_from_one():
    assert runs_words((0,)) == "run 1"
    assert runs_words((0, 2, 3)) == "runs 1, 3 and 4"
