"""Checked reading of configuration: a refusal names the source, the key and what is expected."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from datetime import date
from math import inf, nan
from numbers import Real
from typing import Any, TypeVar

from stepdiag_ros.metrology.refusal import Fault, Findings, Refusal
from stepdiag_ros.metrology.spelling import nearest, suggestion
from stepdiag_ros.metrology.units import MILLI

UNKNOWN = "unknown"
"""What a file says where a number is not known."""
_MISSING: Any = object()
Item = TypeVar("Item")

FASTEST_FEED = 5.0
"""m/s: a larger one was meant in m/min."""
_MOST_SHOWN = 60
_MOST_LISTED = 12


def _shown(value: Any) -> str:
    """Return a value as a person knows it from the file, cut where it is long."""
    text = {True: "true", False: "false"}[value] if isinstance(value, bool) else repr(value)
    text = "empty" if value is None else text
    return text if len(text) <= _MOST_SHOWN else f"{text[:_MOST_SHOWN]}…"


def no_more_than(
    most: int, items: Iterable[Item], size: Callable[[Item], int], refusal: str
) -> list[Item]:
    """Return a list of what is made one after another; end at a limit of all their sizes.

    Raises:
        ValueError: with the words of ``refusal``, as soon as the limit is passed.
    """
    made, total = [], 0
    for item in items:
        total += size(item)
        if total > most:
            raise ValueError(refusal)
        made.append(item)
    return made


_UNITS = {
    "_m_per_s2": "m/s²",
    "_m_per_s": "m/s",
    "_per_s": "1/s",
    "_rad": "rad",
    "_hz": "Hz",
    "_m": "m",
    "_s": "s",
}
"""Ending of a key → unit of its value; those that end alike are there from the longest on."""


class Section:
    """One mapping of a configuration file, from which every key must be taken once.

    Args:
        mapping: the parsed mapping.
        source: what the user calls it: the file, and the keys that lead here.

    Raises:
        ValueError: in every method, when a value is missing, of the wrong type or out of range.
    """

    def __init__(self, mapping: Any, source: str) -> None:
        if mapping is None:
            raise Refusal(f"{source}: expected keys with values, found nothing", fault="too_few")
        if not isinstance(mapping, Mapping):
            raise Refusal(
                f"{source}: expected keys with values, found {_shown(mapping)}",
                fault="malformed",
                aspect="section",
            )
        self._mapping = mapping
        self._source = source
        self._taken: set[str] = set()

    @property
    def source(self) -> str:
        """Return what the user calls the file and the part of it, for the text of an error."""
        return self._source

    def _take(self, key: str, default: Any) -> Any:
        self._taken.add(key)
        value = self._mapping.get(key, _MISSING)
        if value is _MISSING:
            if default is _MISSING:
                near = nearest(key, self.keys())
                hint = f"; is '{near}' a typing error?" if near else ""
                raise Refusal(
                    f"{self._source}: '{key}' is missing{hint}",
                    fault="missing",
                    about=key,
                    where=self._source,
                )
            return default
        return value

    def _wrong(self, key: str, value: Any, expected: str, fault: Fault) -> Refusal:
        return Refusal(
            f"{self._source}: '{key}' is {_shown(value)}; expected {expected}",
            fault=fault,
            about=key,
            where=self._source,
        )

    def require(self, keys: Sequence[str]) -> None:
        """Refuse a section that lacks several of the keys, and name all of them at once."""
        missing = [key for key in keys if key not in self._mapping]
        if len(missing) > 1:
            raise Refusal(
                f"{self._source}: {', '.join(missing)} are missing",
                fault="missing",
                about=", ".join(missing),
                where=self._source,
            )

    def number(
        self, key: str, low: float = -1e12, high: float = 1e12, default: Any = _MISSING
    ) -> float:
        """Return a finite number within [low, high]."""
        value = self._take(key, default)
        # YAML 1.1 reads 1e-7 (no point) as text; a person means the number.
        if isinstance(value, str):
            try:
                value = float(value)
            except ValueError:
                expected = "a number" + (" (with a decimal point: 0.8, not 0,8)" * ("," in value))
                raise self._wrong(key, value, expected, fault="malformed") from None
        if isinstance(value, bool) or not isinstance(value, Real):
            raise self._wrong(key, value, "a number", "malformed")
        try:
            number = float(value)
        except OverflowError:
            number = inf
        if not low <= number <= high:
            expected = f"a number {_range_of(key, low, high, number)}"
            raise self._wrong(key, value, expected, fault="out_of_range")
        return number

    def unknown(self, key: str) -> bool:
        """Say whether a key is left out, or the file says ``unknown`` for it."""
        self._taken.add(key)
        return bool(self._mapping.get(key, UNKNOWN) == UNKNOWN)

    def feed(self, key: str) -> float:
        """Return a feed, m/s; one that can only be meant in m/min is refused."""
        feed = self.number(key)
        if not 1e-6 <= feed <= FASTEST_FEED:
            expected = f"1e-06 to {FASTEST_FEED:g} m/s ({FASTEST_FEED * 60.0:g} m/min)"
            if feed > FASTEST_FEED:
                expected += f": {feed:g} m/s is {feed * 60.0:g} m/min"
                expected += f"; write {feed / 60.0:.3g} for {feed:g} m/min"
            raise self._wrong(key, feed, expected, fault="out_of_range")
        return feed

    def feed_or_unknown(self, key: str) -> float:
        """Return a feed, m/s, or NaN where the file says ``unknown``."""
        if self._mapping.get(key) == UNKNOWN:
            self._taken.add(key)
            return nan
        return self.feed(key)

    def integer(self, key: str, low: int, high: int, default: Any = _MISSING) -> int:
        """Return a whole number within [low, high]."""
        value = self._take(key, default)
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            raise self._wrong(
                key, value, f"a whole number from {low} to {high}", fault="out_of_range"
            )
        return value

    def flag(self, key: str, default: Any = _MISSING) -> bool:
        """Return true or false."""
        value = self._take(key, default)
        if not isinstance(value, bool):
            raise self._wrong(key, value, "true or false", fault="malformed")
        return value

    def text(self, key: str, default: Any = _MISSING) -> str:
        """Return a text."""
        value = self._take(key, default)
        if not isinstance(value, str):
            raise self._wrong(key, value, "a text", "malformed")
        return value

    def day(self, key: str, default: Any = _MISSING) -> str:
        """Return a date as text; YAML takes one without quotes for a date of its own."""
        value = self._take(key, default)
        if isinstance(value, date):
            return value.isoformat()
        if not isinstance(value, str):
            raise self._wrong(key, value, "a date such as 2026-11-28", "malformed")
        return value

    def texts(self, key: str, default: Any = _MISSING) -> tuple[str, ...]:
        """Return a list of texts; a single text is a list of one."""
        value = self._take(key, default)
        listed = [value] if isinstance(value, str) else value
        if not isinstance(listed, Sequence) or not all(isinstance(text, str) for text in listed):
            raise self._wrong(key, value, "a list of texts", fault="malformed")
        return tuple(listed)

    def names(self, key: str, known: Sequence[str], default: Any = _MISSING) -> tuple[str, ...]:
        """Return one or several different names out of ``known``."""
        value = self._take(key, default)
        listed = [value] if isinstance(value, str) else value
        if (
            not isinstance(listed, Sequence)
            or not listed
            or len(set(map(str, listed))) < len(listed)
        ):
            raise self._wrong(
                key, value, f"one or more different names of {', '.join(known)}", "malformed"
            )
        for name in listed:
            if name not in known:
                near = nearest(name, known)
                hint = f"; {suggestion(near)}" if near else ""
                expected = f"one of {', '.join(known)}{hint}"
                raise self._wrong(key, name, expected, fault="unknown")
        return tuple(listed)

    def table(self, key: str, known: Sequence[str]) -> dict[str, str]:
        """Return a table of texts (or whole numbers, as texts) to names out of ``known``.

        It is empty if the key is not there.
        """
        value = self._take(key, {})
        if not isinstance(value, Mapping):
            raise self._wrong(
                key, value, f"a table of texts to one of {', '.join(known)}", "malformed"
            )
        table = {}
        for text, name in value.items():
            # YAML 1.1 reads ON, OFF, YES and NO as true and false.
            if isinstance(text, bool) or not isinstance(text, str | int):
                raise self._wrong(key, text, "texts; write it in quotes", fault="malformed")
            if name not in known:
                raise self._wrong(
                    f"{key}: {text}", name, f"one of {', '.join(known)}", fault="unknown"
                )
            table[str(text)] = str(name)
        return table

    def numbers(
        self, key: str, count: int | None = None, default: Any = _MISSING
    ) -> tuple[float, ...]:
        """Return a list of numbers, of the given length if one is given."""
        value = self._take(key, default)
        if not isinstance(value, Sequence) or isinstance(value, str):
            raise self._wrong(key, value, "a list of numbers", "malformed")
        if count is not None and len(value) != count:
            expected = f"a list of {count} numbers"
            torn = all(isinstance(one, int) or ";" in str(one) for one in value)
            if torn and count < len(value) <= 2 * count:
                expected += " (with commas between them and decimal points: 0.8, not 0,8)"
            raise self._wrong(key, value, expected, fault="malformed")
        item = Section({f"{key}[{i}]": entry for i, entry in enumerate(value)}, self._source)
        return tuple(item.number(f"{key}[{i}]") for i in range(len(value)))

    def vector(
        self, key: str, low: float = -100.0, high: float = 100.0, default: Any = _MISSING
    ) -> tuple[float, float, float]:
        """Return three numbers (X, Y, Z), each within [low, high]."""
        x, y, z = self.numbers(key, count=3, default=default)
        for value in (x, y, z):
            if not low <= value <= high:
                expected = f"three numbers {_range_of(key, low, high, value)}"
                raise self._wrong(key, [x, y, z], expected, fault="out_of_range")
        return x, y, z

    def vectors(
        self, key: str, low: float = -100.0, high: float = 100.0
    ) -> tuple[tuple[float, float, float], ...]:
        """Return a list of at least one triple of numbers (X, Y, Z), each within [low, high]."""
        value = self._take(key, _MISSING)
        if not isinstance(value, Sequence) or isinstance(value, str) or not value:
            raise self._wrong(key, value, "a list of places [x, y, z]", fault="malformed")
        item = Section({f"{key}[{i}]": entry for i, entry in enumerate(value)}, self._source)
        return tuple(item.vector(f"{key}[{i}]", low, high) for i in range(len(value)))

    def section(self, key: str) -> "Section":
        """Return a nested mapping; empty if the key is not there."""
        return Section(self._take(key, {}), f"{self._source}: {key}")

    def sections(self, key: str) -> list["Section"]:
        """Return a list of at least one nested mapping."""
        value = self._take(key, _MISSING)
        if not isinstance(value, Sequence) or isinstance(value, str) or not value:
            raise self._wrong(key, value, "a list with at least one entry", fault="malformed")
        return [Section(entry, f"{self._source}: {key}[{i}]") for i, entry in enumerate(value)]

    def given(self, keys: Sequence[str]) -> dict[str, Any]:
        """Return those of the keys that are there, with their values, for another to check."""
        self._taken.update(keys)
        return {key: self._mapping[key] for key in keys if key in self._mapping}

    def keys(self) -> list[str]:
        """Return the keys that are there, as texts."""
        return [str(key) for key in self._mapping]

    def finish(self) -> None:
        """Refuse keys that nothing has asked for: they are typing errors; all of them at once."""
        findings = Findings()
        for key in self._mapping:
            if key not in self._taken:
                near = nearest(key, sorted(self._taken))
                known = ", ".join(sorted(self._taken)) or "none"
                few = len(self._taken) <= _MOST_LISTED
                hint = f"; {suggestion(near)}" if near else f"; known: {known}" * few
                findings.found.append(
                    Refusal(
                        f"{self._source}: unknown key '{key}'{hint}",
                        fault="unknown",
                        about=str(key),
                        where=self._source,
                    )
                )
        findings.refuse()


def _range_of(key: str, low: float, high: float, value: float) -> str:
    """Return the range of a key's values with their unit, and what a value beyond it may be."""
    name = key.partition("[")[0]
    unit = next((unit for ending, unit in _UNITS.items() if name.endswith(ending)), "")
    said = f"from {low:g} to {high:g} {unit}".rstrip()
    if unit == "m" and value and low <= value * MILLI <= high:
        return f"{said}; {value:g} mm is {value * MILLI:g}"
    return said
