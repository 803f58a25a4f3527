"""A recorded run as the view in a terminal hears of it."""

import threading
from pathlib import Path

import pytest

from stepdiag_ros.bags.run import load_run
from stepdiag_ros.viewers.page.replay import Replay
from stepdiag_ros.viewers.page.state import PageState

BAG = Path(__file__).parents[3] / "docs" / "examples" / "small_run.mcap"


@pytest.fixture(scope="session")
def bag():
    return BAG


@pytest.fixture(scope="session")
def run():
    """Return what the bag holds, read by the other way there is."""
    return load_run(BAG)


@pytest.fixture(scope="session")
def ended():
    """Return the documents of all sections of a run that has ended."""
    state = PageState()
    replay = Replay(BAG, state)
    replay.play(0.0, threading.Event())
    replay.close()
    return state.news()[1]
