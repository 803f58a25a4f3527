"""The embedded client and a real ROS 2 on one network, each asking the other.

Where no ROS 2 is sourced, the embedded client asks itself, so that the questions stay right. With
one (docs/ros2.md):

    PYTEST_DISABLE_PLUGIN_AUTOLOAD=1 .venv/bin/python -m pytest -vv -rs test/interoperability
"""

from __future__ import annotations

from functools import cache

import pytest
import two_clients
from random_content import message_types
from two_clients import NO_SERVICES, SUBJECTS, Found, NotThere

PAIRS = [("embedded", "embedded"), ("embedded", "real"), ("real", "embedded")]
LEAST = {
    "latched": 2,
    "services": 3,
    "parameters": 11,
    "lifecycle": 10,
    "actions": 7,
    "graph": 4,
}
"""How many checks a subject has, at least: a check that is left out must be seen."""


@cache
def found(server: str, asker: str) -> Found:
    """Return what an asker finds out about a server."""
    subjects = SUBJECTS
    if "real" in (server, asker) and "cyclone" not in two_clients.middleware():
        subjects = NO_SERVICES
    with two_clients.serving(server):
        return two_clients.ask(asker, subjects)


@pytest.mark.parametrize("subject", [*SUBJECTS, "endpoints"])
@pytest.mark.parametrize(("server", "asker"), PAIRS, ids=lambda side: side)
def test_both_sides_agree(server: str, asker: str, subject: str) -> None:
    try:
        checks = found(server, asker)
    except NotThere as why:
        pytest.skip(str(why))
    if subject not in checks:
        assert subject not in NO_SERVICES and "real" in (server, asker)
        pytest.skip(f"services do not cross between {two_clients.middleware()} and Cyclone DDS")
    failed = {check: detail for check, (ok, detail) in checks[subject].items() if not ok}
    assert not failed
    if subject in LEAST:
        assert len(checks[subject]) > LEAST[subject]
    else:
        assert set(message_types()) <= set(checks[subject])
