"""A driver of another package, as ``docs/devices.md`` has it: the node opens it like our own."""

import json
import re

import pytest
from other_package import ROOT, install, python

PAGE = (ROOT / "docs" / "devices.md").read_text(encoding="utf-8")
(MODULE,) = re.findall(r"`workshop_file.py`:\n\n```python\n(.*?)```", PAGE, re.DOTALL)
GROUP, KEY, VALUE = re.search(r'entry-points."(\S+)"]\n(\w+) = "(\S+)"', PAGE).groups()
ASK = """
import json, sys
from stepdiag_ros.devices import Surroundings, known_drivers, prepare

assert sys.argv[1] in known_drivers("weather")
device = prepare("weather", sys.argv[1], json.loads(sys.argv[2]), Surroundings())(0)
try:
    print(json.dumps([device.poll(0), device.poll(1), device.poll(1_500_000_000)]))
finally:
    device.close()
"""


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    install(folder, "workshop-file", {VALUE.partition(":")[0]: MODULE}, {GROUP: {KEY: VALUE}})
    return folder


def ask(site, settings):
    return python("-c", ASK, KEY, json.dumps(settings), site=site)


def test_it_is_read_once_a_second_in_the_units_of_the_package(site, tmp_path):
    (tmp_path / "climate.txt").write_text("20.5 101300 45 20.1")
    done = ask(site, {"path": str(tmp_path / "climate.txt")})
    assert done.returncode == 0, done.stderr
    sample = [20.5, 101300.0, 0.45, 20.1]
    assert json.loads(done.stdout) == [[[0, sample]], [], [[1_500_000_000, sample]]]


@pytest.mark.parametrize(
    ("text", "settings", "error"),
    [
        (None, {}, "FileNotFoundError"),
        ("20.5 warm 45 20.1", {}, "ValueError"),
        ("20.5 101300 45 20.1", {"rate": 5}, "Refusal"),
    ],
    ids=["no file", "no number", "unknown setting"],
)
def test_what_is_wrong_raises_what_the_page_says(site, tmp_path, text, settings, error):
    if text is not None:
        (tmp_path / "climate.txt").write_text(text)
    done = ask(site, {"path": str(tmp_path / "climate.txt"), **settings})
    assert done.returncode == 1
    assert done.stderr.strip().splitlines()[-1].partition(":")[0].endswith(error)
