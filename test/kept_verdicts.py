"""A verdict takes a second, and commands ask for it again and again about the same lines."""

import pickle

import pytest

from stepdiag_ros.evaluation import recorded_run


@pytest.fixture(scope="module", autouse=True)
def kept_verdicts():
    """Judge the same lines once in a module, whichever bag and command they come from."""
    judge, kept = recorded_run.verdict_on, {}

    def verdict_on(measurement):
        lines = pickle.dumps(measurement)
        if lines not in kept:
            kept[lines] = judge(measurement)
        return kept[lines]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(recorded_run, "verdict_on", verdict_on)
        yield
