"""Drivers are found by name: our own by their modules, those of other packages by entry point."""

import sys

import pytest
from drivers_for_tests import bring_drivers
from refused import refused

from stepdiag_ros.devices import Surroundings, known_drivers, prepare, weather
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
        bring_drivers(monkeypatch, *entries)
        monkeypatch.setitem(sys.modules, "lab_package", sys.modules[__name__])

    return install


def test_our_own_drivers_are_the_modules_with_settings(installed):
    installed()
    assert {kind: known_drivers(kind) for kind in ("cnc", "interferometer", "weather")} == {
        "cnc": ["grbl", "linuxcnc", "linuxcncrsh", "opcua", "ros2_control", "simulated"],
        "interferometer": ["file_tail", "ids3010", "line_protocol", "simulated"],
        "weather": ["line_protocol", "simulated"],
    }


def test_a_module_put_into_the_folder_is_a_driver(tmp_path, monkeypatch):
    text = (
        "def from_settings(settings, surroundings):\n    return lambda start: (settings, start)\n"
    )
    (tmp_path / "barometer.py").write_text(text)
    (tmp_path / "barometer_part.py").write_text("")
    monkeypatch.setattr(weather, "__path__", [*weather.__path__, str(tmp_path)])
    assert known_drivers("weather") == ["barometer", "line_protocol", "simulated"]
    assert prepare("weather", "barometer", {"port": "a"}, Surroundings())(5) == ({"port": "a"}, 5)
    for part in ("barometer_part", "barometer.py", "__init__"):
        with refused(Refusal, "unknown", part, "barometer"):
            prepare("weather", part, {}, Surroundings())
    for name in ("barometer", "barometer_part"):
        sys.modules.pop(f"{weather.__name__}.{name}")


def test_a_driver_of_another_package_is_used_like_our_own(installed):
    installed(("weather", "lab", "lab_package:gauge"))
    assert known_drivers("weather")[-1] == "lab"
    assert "lab" not in known_drivers("cnc")
    device = prepare("weather", "lab", {"port": "a"}, Surroundings())(5)
    assert (device.settings, device.start) == ({"port": "a"}, 5)


def test_a_name_that_no_package_or_two_packages_bring_is_refused(installed):
    installed(
        ("weather", "simulated", "lab_package:gauge"),
        ("weather", "gone", "lab_package:nothing"),
        ("weather", "lost", "no_such_package:gauge"),
    )
    with refused(Refusal, "unknown", "lap"):
        prepare("weather", "lap", {}, Surroundings())
    with refused(Refusal, "ambiguous", "simulated", "2"):
        prepare("weather", "simulated", {}, Surroundings())
    for name in ("gone", "lost"):
        with refused(Refusal, "failed", name):
            prepare("weather", name, {}, Surroundings())
