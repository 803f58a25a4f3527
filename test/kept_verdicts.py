"""A verdict takes a second, and commands ask for it again and again about the same lines."""

import pickle

import pytest

from stepdiag_ros.evaluation import build, recorded_run


def kept(function):
    """Return a function of a measurement that is evaluated once for the same lines."""
    known = {}

    def asked(measurement):
        lines = pickle.dumps(measurement)
        if lines not in known:
            known[lines] = function(measurement)
        return known[lines]

    return asked


@pytest.fixture(scope="module", autouse=True)
def kept_verdicts():
    """Judge the same lines once in a module, whichever bag and command they come from."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(recorded_run, "verdict_on", kept(recorded_run.verdict_on))
        yield


@pytest.fixture(scope="module")
def kept_results():
    """Solve the same lines once in a module that asks what is made of results."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(build, "solve_reproducibly", kept(build.solve_reproducibly))
        yield
