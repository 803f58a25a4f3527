"""Compensation tables as written, loaded by a real LinuxCNC: its motors go where they should."""

from pathlib import Path

import numpy as np
import pytest
from linuxcnc_watched import Watched

from stepdiag_ros.compensation import control
from stepdiag_ros.compensation.control import Layout, checked_settings
from stepdiag_ros.compensation.identified import Identified
from stepdiag_ros.devices.cnc import CncState
from stepdiag_ros.metrology.geometry import TRANSLATIONS
from stepdiag_ros.metrology.volumetric_map import VolumetricMap

NODES = np.linspace(0.0, 0.04, 5)
ERROR = {
    "E_XX": 1e-6 * np.array([0.0, 9.0, 4.0, -6.0, -20.0]),
    "E_YY": 1e-6 * np.array([0.0, -3.0, -8.0, -5.0, 7.0]),
    "E_ZZ": 1e-6 * np.array([0.0, 2.0, 1.0, 12.0, 30.0]),
}
REVERSAL = 3e-6 * np.ones(5)
NEAR = 0.6e-6
"""m: the in-position window, and the end of a drive's lag."""


SAMPLES = 5
"""That agree once LinuxCNC has added all of a table's value, for which it takes its time."""


def expected(target, sense):
    """Return what the tables add to the motors of X, Y and Z at a target, m."""
    added = np.array([-np.interp(target, NODES, error) for error in ERROR.values()])
    added[0] -= sense * 0.5 * REVERSAL[0]
    return added


def added(samples):
    """Return what was added to the motors in each sample, m, shape (n, 3)."""
    return np.array([np.subtract(one.motors, one.position) for one in samples])


@pytest.mark.parametrize("kind", [1, 0])
def test_linuxcnc_goes_where_the_tables_say_in_both_directions(make_instance, tmp_path, kind):
    curves = {name: ERROR.get(name, np.zeros(5)) for name in TRANSLATIONS}
    error_map = VolumetricMap((NODES, NODES, NODES), curves)
    identified = Identified(error_map, {0: REVERSAL})
    found = control("linuxcnc")
    layout = Layout(settings=checked_settings(found, {"type": kind}))
    files = found.write(identified, layout)
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    tables = {letter: Path(tmp_path / f"{letter.lower()}.comp") for letter in "XYZ"}
    machine = make_instance(tables=tables, table_type=kind)
    watched = Watched(machine.socket)
    watched.reset()
    # Ahead and back, at nodes and between them.
    for sense, targets in ((+1, (0.005, 0.01, 0.02, 0.033, 0.04)), (-1, (0.03, 0.015, 0.002))):
        for target in targets:
            watched.go(*[1e3 * target] * 3, feed=0.2, axes="XYZ")
            watched.until_state(CncState.READY)
            should = pytest.approx(np.tile(expected(target, sense), (SAMPLES, 1)), abs=5e-9)
            watched.until(lambda: added(watched.samples()[-SAMPLES:]) == should)  # noqa: B023
            assert watched.samples()[-1].position == pytest.approx([target] * 3, abs=NEAR)
    watched.driver.close()
    machine.stop()
