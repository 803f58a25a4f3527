"""Which names of a catalogue mean an effect of the blind test.

The catalogue and the generator were written apart; this is the dictionary between their words. It
sees names and settings only, never readings.
"""

import re
from typing import NamedTuple

NEAR = 2
"""Stops by which a jump may be placed wrongly and still be the jump that was hidden."""


class Entry(NamedTuple):
    """A candidate of the catalogue by its words."""

    effect: str
    setting: dict
    label: str


def _has(entry, *values):
    """Tell whether every value is one of the setting's, or a word of one."""
    words = {
        word
        for value in entry.setting.values()
        for word in (str(value), *re.split(r"[^A-Za-z0-9_]+", str(value)))
    }
    return all(str(value) in words for value in values)


NAMES = {
    "backlash": ("backlash",),
    "settling": ("settling",),
    "growth": ("thermal growth",),
    "growth_in_time": ("growth with time", "warm-up growth"),
    "angular": ("angular error", "wavy angular error"),
    "dead_path": ("dead path",),
    "air": ("uncompensated air temperature",),
    "cosine": ("cosine error",),
    "slip": ("fringe slip",),
    "sag": ("sag",),
    "drift": ("drift", "warm-up drift"),
    "reading_drift": ("drift", "warm-up drift"),
}
"""Kind → effects of the catalogue that mean it. A warm-up of long time constant grows in time."""


def _line_words(setup):
    return [word for word in setup[1:] if word]


def _is_place(entry, setting, setup):
    if not _has(entry, *_line_words(setup), setting["direction"]):
        return False
    if entry.setting.get("repeat", setting["repeat"]) != setting["repeat"]:
        return False
    stops = [
        value
        for name, value in entry.setting.items()
        if name != "repeat" and isinstance(value, int | float)
    ]
    return any(abs(stop - setting["stop"]) <= NEAR for stop in stops)


def means(entry, kind, setting, setups):
    """Tell whether a candidate of the catalogue is a hidden effect.

    Args:
        entry: the candidate.
        kind: of the hidden effect.
        setting: of the hidden effect.
        setups: (kind, line, order) of each setup of the plan.
    """
    if entry.effect not in NAMES.get(kind, ()):
        return False
    if kind == "slip":
        return _is_place(entry, setting, setups[setting["setup"]])
    if kind == "cosine":
        return _has(entry, *_line_words(setups[setting["setup"]]))
    if kind == "sag":
        return _has(entry, setting["component"].upper(), setting["pair"].upper())
    if kind == "drift":
        return _has(entry, setting["direction"].upper())
    if kind == "reading_drift":
        return _has(entry, "beam")
    return _has(entry, *setting.values())
