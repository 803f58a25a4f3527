"""The shipped files of settings are accepted by the drivers that they are for."""

import re

import pytest

from stepdiag_ros.configuration import load_device
from stepdiag_ros.devices import Surroundings, prepare
from stepdiag_ros.metrology.machine import Machine

MACHINE = Machine("m", "XYZ", (-0.3, -0.3, -0.3), (0.0, 0.0, 0.0), 0.1, 1.0)


@pytest.mark.parametrize(
    ("file", "driver"),
    [
        ("grbl", "grbl"),
        ("grblhal_tcp", "grbl"),
        ("opcua", "opcua"),
        ("opcua_sinumerik", "opcua"),
    ],
)
def test_a_shipped_file_is_accepted(file, driver, tmp_path, monkeypatch):
    # The files name certificates in the home of whoever runs it.
    monkeypatch.setenv("HOME", str(tmp_path))
    settings, text = load_device(file)
    for name in re.findall(r"~/(\.stepdiag/\S+)", text):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("x")
    settings["position_rate_hz"] = 50.0
    assert callable(prepare("cnc", driver, settings, Surroundings(MACHINE)))
    assert f"# Driver: {driver} (cnc)" in text
