"""Drivers are found by name: our own in the table, those of other packages by entry point."""

import sys
from importlib.metadata import EntryPoint, EntryPoints

import pytest
from refused import refused

from stepdiag_ros import devices
from stepdiag_ros.devices import Surroundings, known_drivers, prepare
from stepdiag_ros.metrology.refusal import Refusal


class Gauge:
    def __init__(self, settings, start):
        self.settings, self.start = settings, start


def gauge(settings, surroundings):
    assert surroundings.machine is None
    return lambda start: Gauge(settings, start)


@pytest.fixture
def installed(monkeypatch):
    """Return a function that lets other packages bring drivers."""

    def install(*entries):
        points = EntryPoints(EntryPoint(name, place, group) for group, name, place in entries)
        monkeypatch.setattr(devices, "entry_points", points.select)
        monkeypatch.setitem(sys.modules, "lab_package", sys.modules[__name__])

    return install


def test_a_driver_of_another_package_is_used_like_our_own(installed):
    installed(("stepdiag_ros.weather", "lab", "lab_package:gauge"))
    assert known_drivers("weather")[-1] == "lab"
    assert "lab" not in known_drivers("cnc")
    device = prepare("weather", "lab", {"port": "a"}, Surroundings())(5)
    assert (device.settings, device.start) == ({"port": "a"}, 5)


def test_a_name_that_no_package_or_two_packages_bring_is_refused(installed):
    installed(
        ("stepdiag_ros.weather", "simulated", "lab_package:gauge"),
        ("stepdiag_ros.weather", "gone", "lab_package:nothing"),
        ("stepdiag_ros.weather", "lost", "no_such_package:gauge"),
    )
    with refused(Refusal, "unknown", "lap"):
        prepare("weather", "lap", {}, Surroundings())
    with refused(Refusal, "ambiguous", "simulated", "2"):
        prepare("weather", "simulated", {}, Surroundings())
    for name in ("gone", "lost"):
        with refused(Refusal, "failed", name):
            prepare("weather", name, {}, Surroundings())
