"""Which names of a catalogue mean an effect of the blind test, and which words a gross error.

The catalogue and the generator were written apart; this is the dictionary between their words. It
sees names, settings and sentences only, never readings.
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


_ANGULAR = ("angular error", "wavy angular error")
_DRIFT = ("drift", "warm-up drift")
_GROWTH = ("growth with time", "warm-up growth")
NAMES = {
    "backlash": ("backlash",),
    "settling": ("settling",),
    "servo_lag": ("servo lag",),
    "trigger": ("position-trigger delay",),
    "growth": ("thermal growth",),
    "growth_in_time": _GROWTH,
    "warming_growth": _GROWTH,
    "angular": _ANGULAR,
    "curved_angular": _ANGULAR,
    "wavy_angular": _ANGULAR,
    "roll": _ANGULAR,
    "dead_path": ("dead path",),
    "air": ("uncompensated air temperature",),
    "air_pressure": ("uncompensated air pressure",),
    "expansion": ("wrong expansion coefficient",),
    "cosine": ("cosine error",),
    "slip": ("fringe slip",),
    "beam_break": ("beam-break jump",),
    "nonlinearity": ("interferometer nonlinearity",),
    "beam_walk": ("beam walk on the mirror",),
    "mirror_tilt": ("mirror tilt under travel",),
    "abbe": ("Abbe offset",),
    "sag": ("sag",),
    "drift": _DRIFT,
    "warming_drift": _DRIFT,
    "reading_drift": _DRIFT,
    "warming_laser": _DRIFT,
    "scale": ("scale",),
    "squareness": ("squareness",),
    "pitch": ("pitch-periodic error",),
    "wavelength": ("wrong wavelength",),
}
"""Kind → effects of the catalogue that mean it: slow warming and a steady change are one name."""

_SQUARENESS = {"XY": "C0Y", "XZ": "B0Z", "YZ": "A0Z"}


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
        if name not in ("repeat", "run") and isinstance(value, int | float)
    ]
    return any(abs(stop - setting["stop"]) <= NEAR for stop in stops)


def _of_later_run(entry):
    """Tell whether a candidate belongs to an alignment or a pass of a later run."""
    words = [str(value) for value in entry.setting.values()]
    return entry.setting.get("run", 1) != 1 or any(word.startswith("run ") for word in words)


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
    if "setup" in setting:
        setup = setups[setting["setup"]]
        if _of_later_run(entry):
            return False
        if "stop" in setting:
            return _is_place(entry, setting, setup)
        further = [setting["axis"]] if "axis" in setting else []
        return _has(entry, *_line_words(setup), *further)
    if kind == "sag":
        return _has(entry, setting["component"].upper(), setting["pair"].upper())
    if kind == "squareness":
        return _has(entry, _SQUARENESS["".join(sorted((setting["axis"], setting["component"])))])
    if "direction" in setting:
        return _has(entry, setting["direction"].upper())
    if kind in ("reading_drift", "warming_laser"):
        return _has(entry, "beam")
    where = [setting[name] for name in ("axis", "error", "period") if name in setting]
    return _has(entry, *where)


def is_at(entry, setup, stop):
    """Tell whether a candidate is a jump at a stop of a setup's first pass, or back at the next.

    That is one way to say that a single reading is wrong.
    """
    jumps = ("fringe slip", "beam-break jump")
    place = {"direction": "forward", "repeat": 0}
    return entry.effect in jumps and any(
        _is_place(entry, {**place, "stop": one}, setup) and one in entry.setting.values()
        for one in (stop, stop + 1)
    )


def is_one_of(entry, setup, jumps):
    """Tell whether a candidate is a jump at one of some places of a setup."""
    named = entry.effect in ("fringe slip", "beam-break jump")
    return named and any(_is_place(entry, one, setup) for one in jumps)


_QUANTITIES = (
    (r"the place of ([XYZ])", ("place {}",)),
    (r"the sense of ([XYZ])'s last move", ("sense {}",)),
    (r"the time since ([XYZ]) turned round", ("reversal {}", "sense {}")),
    (r"time", ("time",)),
    (r"time, periodically", ("period",)),
    (r"the (air|material) temperature", ("{}",)),
    (r"the length of the (?:beam's )?path", ("path",)),
    (r"the line", ("line",)),
)
"""Words of a description → the generator's (``blind_drivers``). What creeps has a sense."""


def quantities_of(drivers, one_temperature=False):
    """Return the quantities that a description's words mean; unknown words stand for themselves.

    Args:
        drivers: words of the description.
        one_temperature: air and material have the same temperature throughout.
    """
    meant = set()
    for words in drivers:
        found = [(re.fullmatch(pattern, words), names) for pattern, names in _QUANTITIES]
        names = [one.format(*match.groups()) for match, some in found if match for one in some]
        meant |= set(names or [words])
    if one_temperature and "air" in meant:
        meant = meant - {"air"} | {"material"}
    return meant


_GROSS_WORDS = {
    "reversed_axis": r"\b{axis}\b[^.;]*(runs|moves) (backwards|the other way)",
    "swapped_axes": r"({axis}, {other}|{other}, {axis}|wrong step, line or axis)",
    "wrong_line": r"{line}",
    "wrong_order": r"{order}",
    "sign": r"\bsign\b",
    "millimetres": r"\b(mm|millimetres)\b",
    "inches": r"\binches\b",
    "half": r"\bhalf\b",
    "turned_pass": r"exchanged|forward|backward|\bsign\b",
    "outlier": r"\bstop {stop}\b",
    "repeated_row": r"\btwice\b",
    "lost_row": r"\bmissing\b",
    "positions_in_mm": r"\b(mm|millimetres)\b",
    "renamed_rows": r"{line}|positions",
}
"""Gross error → what a sentence must say of it."""
_AS_A_TABLE = {
    "reversed_axis": r"\bsign\b|backward|positions? ha(s|ve) changed",
    "swapped_axes": r"positions? ha(s|ve) changed|{axis}|{other}",
    "wrong_order": r"{order}|positions? ha(s|ve) changed",
    "inches": r"inch|positions? ha(s|ve) changed",
    "half": r"half|positions? ha(s|ve) changed",
    "turned_pass": r"backward|\bsign\b|positions? ha(s|ve) changed",
}
"""A table is refused at its first row that cannot be; that the row is wrong is then enough."""


def rightly_said(gross, text, refused):
    """Tell whether a sentence says which gross error it is.

    Args:
        gross: what was done: ``kind`` and where.
        text: all that was said.
        refused: whether that is the refusal of a table.
    """
    words = dict(_GROSS_WORDS)
    if refused:
        words.update(_AS_A_TABLE)
    named = {key: re.escape(str(value)) for key, value in gross.items()}
    return bool(re.search(words[gross["kind"]].format(**named), text))
