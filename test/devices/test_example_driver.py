"""The drivers that the page on devices shows: one of them against a peer, and both clean."""

import re
import subprocess
import sys
from math import isnan
from pathlib import Path

import pytest
from instrument_peers import MS, SECOND, Bench, TcpPeer
from refused import refused

from stepdiag_ros.devices import Surroundings
from stepdiag_ros.devices.interferometer import STATUS_BEAM_LOST, STATUS_OK
from stepdiag_ros.metrology.refusal import Refusal

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "devices.md").read_text(encoding="utf-8")
MODULES = dict(re.findall(r"Module `(\w+\.py)`:\n\n```python\n(.*?)```", PAGE, re.DOTALL))
ALIGNMENT = ((0.01, 0.01, 0.01), (0.0, 0.0, 0.0))


@pytest.fixture(scope="module")
def from_settings():
    module = {"__name__": "lab_counter"}
    exec(MODULES["lab_counter.py"], module)
    return module["from_settings"]


@pytest.fixture
def bench(from_settings):
    peer = TcpPeer()
    bench = Bench(peer, step=2 * MS)
    settings = {"host": "127.0.0.1", "port": peer.port}
    bench.open(from_settings(settings, Surroundings()))
    bench.connect()
    yield bench
    bench.device.close()
    peer.close()


def say(bench, *lines):
    """Let the instrument send lines; return the readings that come of them."""
    bench.peer.say("".join(f"{line}\r\n" for line in lines))
    return bench.until(len(lines))


def test_readings_are_numbered_and_in_metres_and_order(bench):
    readings = say(bench, "D=+0.100000 mm", "D=+0.250000 mm") + say(bench, "D=-1.000000 mm")
    assert [one.raw_displacement for one in readings] == pytest.approx([1e-4, 2.5e-4, -1e-3])
    assert [one.sequence for one in readings] == [0, 1, 2]
    assert readings[0].time < readings[1].time < readings[2].time
    assert all(isnan(one.compensated_displacement) for one in readings)


def test_an_alignment_sets_the_zero_and_a_loss_lasts_until_the_next(bench):
    bench.device.align(bench.now, "x", "x", *ALIGNMENT)
    first, second = say(bench, "D=+5.000000 mm", "D=+6.000000 mm")
    assert (first.raw_displacement, second.raw_displacement) == pytest.approx((0.0, 1e-3))
    bench.device.align(bench.now, "x", "x", *ALIGNMENT)
    lost, back = say(bench, "D=LOST", "D=+6.000000 mm")
    assert isnan(lost.raw_displacement)
    assert (lost.status, back.status) == (STATUS_BEAM_LOST, STATUS_BEAM_LOST)
    bench.device.align(bench.now, "x", "x", *ALIGNMENT)
    (again,) = say(bench, "D=+7.000000 mm")
    assert (again.status, again.raw_displacement) == (STATUS_OK, 0.0)


def test_silence_and_nonsense_are_errors(bench):
    bench.now += 4 * SECOND
    with refused(TimeoutError):
        bench.look()
    bench.peer.say("E17\n")
    with refused(ValueError, None, "E17"):
        bench.for_looks(2000)


def test_its_settings_are_checked(from_settings):
    for wrong, fault in (({}, "missing"), ({"port": 0}, "out_of_range"), ({"rate": 1}, "unknown")):
        settings = {"host": "127.0.0.1", "port": 4001, **wrong}
        with refused(Refusal, fault):
            from_settings(settings if wrong else {}, Surroundings())


@pytest.mark.parametrize("name", sorted(MODULES))
def test_the_examples_are_clean(tmp_path, name):
    source = tmp_path / name
    source.write_text(MODULES[name])
    settings = ("--config", str(ROOT / "pyproject.toml"), str(source))
    for check in (("ruff", "check"), ("ruff", "format", "--check"), ("mypy", "--strict")):
        arguments = settings if check[0] == "ruff" else (str(source),)
        done = subprocess.run(
            [sys.executable, "-m", *check, *arguments], cwd=ROOT, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stdout
