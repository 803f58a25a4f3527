"""The options that compensate a recorded run for the air anew: what they refuse, and how."""

from argparse import ArgumentParser
from pathlib import Path

import pytest
from refused import a_fault, refused

from stepdiag_ros.commands.air import AS_MEASURED, add_air_options, air_choice
from stepdiag_ros.evaluation.recorded_run import measurement_of
from stepdiag_ros.metrology.air.recompensation import AirChoice
from stepdiag_ros.metrology.refusal import Refusal


def chosen(*words):
    parser = ArgumentParser()
    add_air_options(parser)
    return air_choice(parser.parse_args(words))


def test_options_become_a_choice():
    assert chosen() is None
    assert chosen("--air", "off") == AirChoice("off")
    assert chosen("--air", "own") == AirChoice("own")
    given = chosen(
        *("--air", "own", "--dead-path", "0.35", "--index-equation", "ciddor"),
        *("--wavelength", "1530e-9", "--weather-age", "60"),
    )
    assert given == AirChoice("own", 0.35, 1530e-9, "ciddor", 60.0)
    assert set(AS_MEASURED) == {"air", "dead_path", "index_equation", "wavelength", "weather_age"}


@pytest.mark.parametrize("words", [("--dead-path", "1"), ("--air", "off", "--wavelength", "5e-7")])
def test_an_option_that_serves_nothing_is_refused(words):
    with refused(Refusal, "mismatch", "--air", aspect="compensation"):
        chosen(*words)


@pytest.mark.parametrize("words", [("--dead-path", "-1"), ("--air", "mine"), ("--wavelength", "1")])
def test_values_out_of_range_are_refused(words, capsys):
    with pytest.raises(SystemExit):
        chosen(*words)
    assert words[0] in capsys.readouterr().err


class Recorded:
    """A run of which the recording has only so much."""

    path, begun_late, commands, arrivals = Path("run.mcap"), False, ("a command",), ()
    flaws = ()

    def __init__(self, **known):
        self.__dict__.update(known)

    def weather(self):
        return []


@pytest.mark.parametrize(
    ("recorded", "recorded_lines", "words"),
    [
        (Recorded(), True, a_fault("mismatch", "--recorded-lines")),
        (Recorded(begun_late=True), False, a_fault("too_few")),
        (Recorded(commands=()), False, a_fault("too_few")),
        (Recorded(), False, a_fault("missing")),
    ],
)
def test_a_recording_that_is_not_enough_is_refused(recorded, recorded_lines, words):
    with refused(Refusal, words):
        measurement_of(recorded, recorded_lines, lambda *_: None, AirChoice("own"))
