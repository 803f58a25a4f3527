"""The options --until and --conditions: what goes to the sequencer, and what is said of a run."""

from argparse import ArgumentParser
from dataclasses import replace
from math import nan

import pytest
from refused import refused

from stepdiag_ros.cli import main
from stepdiag_ros.commands.until import TargetTeller, add_until, until_of
from stepdiag_ros.configuration import target_from_text
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.target import TargetStanding, TargetState

CONDITIONS = "device_U_m_per_m: 1.0e-6\nenvironmental_variation_m: 2.0e-7\n"
OPEN = TargetStanding("E_XX", "m", 1e-6, nan, 9e-7, 60.0, TargetState.OPEN, 0, "nothing yet")


def given(*arguments):
    parser = ArgumentParser()
    add_until(parser)
    return until_of(parser.parse_args(list(map(str, arguments))))


def test_a_target_goes_as_it_was_written_and_with_its_conditions_as_yaml(tmp_path):
    file = tmp_path / "conditions.yaml"
    file.write_text(CONDITIONS)
    assert given() == ""
    assert given("--until", " 0.5um ") == "0.5um"
    target = target_from_text(given("--until", "X:A↑=1um", "--conditions", file))
    assert target.quantity == "X:A↑"
    assert target.conditions.device == 1e-6 and target.conditions.environmental_variation == 2e-7


def test_conditions_alone_and_odd_ones_are_refused(tmp_path):
    file = tmp_path / "conditions.yaml"
    file.write_text(CONDITIONS)
    with refused(Refusal, "missing", "until"):
        given("--conditions", file)
    file.write_text("devise: 1\n")
    with refused(Refusal, "unknown", "devise"):
        given("--until", "X:A=1um", "--conditions", file)


@pytest.mark.parametrize(
    ("until", "named"), [("0.5inch", "inch"), ("E_AB=1um", "E_AB"), ("Y:A=1um", "conditions")]
)
def test_a_run_with_an_impossible_target_starts_nothing(until, named, tmp_path, capsys):
    folder = tmp_path / "results"
    assert main(["run", "--until", until, "--output", str(folder)]) == 1
    (said,) = capsys.readouterr().err.splitlines()
    assert named in said and not folder.exists()


def test_what_is_reached_is_said_once_for_each_line():
    said = []
    tell = TargetTeller(said.append)
    for lines, reached in ((0, nan), (0, nan), (1, 4e-6), (1, 4e-6), (2, 1.4e-6)):
        tell(None)
        tell(replace(OPEN, lines=lines, reached=reached))
    tell(replace(OPEN, state=TargetState.BEYOND_PLAN, lines=3, reached=1.2e-6, time_left=nan))
    tell(replace(OPEN, state=TargetState.REACHED, lines=4, reached=0.8e-6, time_left=0.0, text=""))
    assert len(said) == 5
    for line, numbers in zip(said, ("unknown", "4 µm", "1.4 µm", "1.2 µm", "0.8 µm"), strict=True):
        assert numbers in line and "1 µm" in line
    assert "60 s" in said[0] and "60 s" in said[2]
