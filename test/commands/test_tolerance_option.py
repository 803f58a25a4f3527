"""A tolerance in another unit is refused: it would release a machine, or condemn it."""

import argparse

import pytest

from stepdiag_ros.cli import main
from stepdiag_ros.commands.output import tolerance


@pytest.mark.parametrize(("text", "meant"), [("25000", "25"), ("0.025", "25"), ("25e-6", "25")])
def test_a_tolerance_in_nm_mm_or_m_is_refused_with_what_it_would_be(text, meant):
    with pytest.raises(argparse.ArgumentTypeError) as caught:
        tolerance(text)
    assert f" {meant}?" in str(caught.value)


@pytest.mark.parametrize("text", ["nan", "-25", "0", "25um", "1e12"])
def test_what_no_unit_explains_is_refused_without_a_guess(text):
    with pytest.raises(argparse.ArgumentTypeError) as caught:
        tolerance(text)
    assert "?" not in str(caught.value)


def test_the_finest_and_the_coarsest_machine_have_a_tolerance():
    assert (tolerance("0.1"), tolerance("25"), tolerance("5000")) == (0.1, 25.0, 5000.0)


@pytest.mark.parametrize("command", ["report", "cell"])
def test_the_commands_that_judge_a_machine_refuse_it(command, capsys):
    with pytest.raises(SystemExit) as ended:
        main([command, "--tolerance", "25000"])
    assert ended.value.code == 2 and " 25?" in capsys.readouterr().err
