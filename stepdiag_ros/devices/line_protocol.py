r"""Messages of text as settings describe them: which fields there are, and what numbers they mean.

One description serves instruments, weather sensors and files that grow. A message is split into
fields, by a regular expression with named groups or by columns; a quantity says from which field
it comes and what one unit of it is::

    message:
      pattern: '^(?P<length>[-+.0-9]+) (?P<beam>\d+)$'      # or: separator and columns
      skip: '^#'                                            # messages that hold no values
    values:
      raw: {from: length, unit: mm}
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import isfinite, nan

from stepdiag_ros.metrology.checking import Section
from stepdiag_ros.metrology.refusal import Lost, Refusal

Fields = Mapping[str, str]

SKIPPED = "_"
"""Name of a column that nobody asks for."""
_FORMATS = ("decimal", "hex")


class NoMessage(Refusal):
    """A message does not look as the settings say; the text says what is wrong with it."""


class StartedAgain(Lost):
    """The device says that it was started again: whatever it counted is lost."""


@dataclass(frozen=True)
class MessageSettings:
    """How a message is split into fields.

    Attributes:
        encoding: of the text.
        pattern: found in the message; its named groups are the fields. None: columns.
        separator: between columns; None: any blanks.
        columns: names of the fields in order, ``_`` for those not needed; more may follow.
        skip: a message in which it is found holds no values; None: there are none such.
        restarted: a message in which it is found is sent when the device starts; None: none is.
        decimal_comma: numbers are written with a comma.
    """

    encoding: str
    pattern: re.Pattern[str] | None
    separator: str | None
    columns: tuple[str, ...]
    skip: re.Pattern[str] | None
    restarted: re.Pattern[str] | None
    decimal_comma: bool

    @classmethod
    def from_section(cls, section: Section) -> "MessageSettings":
        """Take the settings from ``pattern``, or from ``separator`` and ``columns``.

        Raises:
            ValueError: a setting is wrong.
        """
        encoding = section.names(
            "encoding", ("ascii", "utf-8", "latin-1", "utf-16"), default=("ascii",)
        )[0]
        pattern = _pattern(section, "pattern")
        separator, columns = None, tuple[str, ...]()
        if pattern is None:
            text = section.text("separator", default=",")
            separator = None if text.strip(" ") in ("", "blanks") else text
            columns = _names(section, "columns")
        elif not pattern.groupindex:
            raise Refusal(
                f"{section.source}: 'pattern' has no named group; write (?P<name>…) around each"
                " value",
                fault="missing",
            )
        settings = cls(
            encoding=encoding,
            pattern=pattern,
            separator=separator,
            columns=columns,
            skip=_pattern(section, "skip"),
            restarted=_pattern(section, "restarted"),
            decimal_comma=section.flag("decimal_comma", default=False),
        )
        section.finish()
        return settings

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the fields."""
        if self.pattern is not None:
            return tuple(self.pattern.groupindex)
        return tuple(name for name in self.columns if name != SKIPPED)

    def split(self, message: bytes) -> Fields | None:
        """Return the fields of a message; None for one that holds no values.

        Raises:
            NoMessage: it does not look as it should.
            StartedAgain: it is what the device says when it starts.
        """
        try:
            text = message.decode(self.encoding)
        except UnicodeDecodeError:
            raise NoMessage(f"{shown(message)} is not {self.encoding} text") from None
        if self.restarted is not None and self.restarted.search(text):
            raise StartedAgain(
                f"the device was restarted: it sent {shown(message)}",
                fault="restarted",
                aspect="greeting",
            )
        if self.skip is not None and self.skip.search(text):
            return None
        if self.pattern is not None:
            match = self.pattern.search(text)
            if match is None:
                raise NoMessage(f"{shown(message)} does not fit the pattern")
            # A group that took no part is a field that this message does not have.
            return {name: value for name, value in match.groupdict().items() if value is not None}
        parts = text.split(self.separator)
        if len(parts) < len(self.columns):
            raise NoMessage(
                f"{shown(message)} has {len(parts)} columns instead of {len(self.columns)}"
            )
        named = zip(self.columns, parts, strict=False)
        return {name: part.strip() for name, part in named if name != SKIPPED}


@dataclass(frozen=True)
class SentQuantity:
    """A number in a message.

    Attributes:
        source: field that it comes from.
        convert: from the number as it is written to our unit.
        base: 10 or 16.
        bits: of a number of base 16 in two's complement; 0: it has no sign.
        decimal_comma: it is written with a comma.
        fine: field that holds a fraction of the last place; empty without one.
        fine_parts: how many parts of the fraction make one of the last place.
        unknown: what the device writes where it does not know the value.
    """

    source: str
    convert: Callable[[float], float]
    base: int = 10
    bits: int = 0
    decimal_comma: bool = False
    fine: str = ""
    fine_parts: float = 1.0
    unknown: tuple[str, ...] = ()

    def number(self, fields: Fields) -> float:
        """Return the number in our unit; NaN where the message does not have or know it.

        Raises:
            NoMessage: it is not a number.
        """
        text = fields.get(self.source)
        if text is None or text in self.unknown:
            return nan
        value = self._read(text)
        if self.fine and self.fine in fields:
            value += self._read(fields[self.fine]) / self.fine_parts
        return self.convert(value)

    def _read(self, text: str) -> float:
        try:
            if self.base == 16:
                value = int(text, 16)
                negative = self.bits > 0 and value >> (self.bits - 1) == 1
                return float(value - (1 << self.bits) if negative else value)
            # A display puts blanks between sign, thousands and decimals.
            plain = text.replace(" ", "")
            number = float(plain.replace(",", ".") if self.decimal_comma else plain)
        except ValueError:
            raise NoMessage(f"'{text[:40]}' is not a number") from None
        if not isfinite(number) or "_" in text:
            raise NoMessage(f"'{text[:40]}' is not a number")
        return number


def quantity(
    values: Section,
    name: str,
    message: MessageSettings,
    units: Mapping[str, Callable[[float], float]],
    more: Callable[[Section], Callable[[float], float] | None] = lambda _: None,
) -> SentQuantity | None:
    """Return a quantity of the settings; None if they do not have it.

    Args:
        values: the part of the settings that lists the quantities.
        name: of this one.
        message: which fields there are.
        units: name of each unit → from it to ours.
        more: takes further keys of the quantity; may return another conversion than the unit's.

    Raises:
        ValueError: a setting is wrong, or there is no such field.
    """
    if name not in values.keys():  # noqa: SIM118
        return None
    section = values.section(name)
    source = field_of(section, "from", name, message)
    convert = more(section) or units[section.names("unit", tuple(units))[0]]
    factor = section.number("factor", default=1.0)
    fine = ""
    if "fine" in section.keys():  # noqa: SIM118
        fine = field_of(section, "fine", "", message)
    base = 16 if section.names("format", _FORMATS, default=("decimal",))[0] == "hex" else 10
    unknown = section.text("unknown", default="")
    found = SentQuantity(
        source=source,
        convert=lambda value: convert(value) * factor,
        base=base,
        bits=section.integer("bits", low=0, high=128, default=0),
        decimal_comma=message.decimal_comma,
        fine=fine,
        fine_parts=section.number("fine_parts", low=1.0, default=1.0),
        unknown=(unknown,) if unknown else (),
    )
    section.finish()
    return found


def field_of(section: Section, key: str, default: str, message: MessageSettings) -> str:
    """Return the field that a key names.

    Raises:
        ValueError: messages have no such field.
    """
    name = section.text(key, default=default) if default else section.text(key)
    if name not in message.names:
        known = ", ".join(message.names)
        raise Refusal(
            f"{section.source}: '{key}' is '{name}'; the message has the fields {known}",
            fault="unknown",
        )
    return name


def times(factor: float) -> Callable[[float], float]:
    """Return the conversion that multiplies by a factor."""
    return lambda value: value * factor


def shown(message: bytes) -> str:
    """Return a message as a person reads it, cut where it is long."""
    text = repr(message[:60])[1:]
    return f"{text}…" if len(message) > 60 else text


def _pattern(section: Section, key: str) -> re.Pattern[str] | None:
    text = section.text(key, default="")
    if not text:
        return None
    try:
        return re.compile(text)
    except re.error as error:
        raise Refusal(
            f"{section.source}: '{key}' is not a regular expression: {error}", fault="malformed"
        ) from None


def _names(section: Section, key: str) -> tuple[str, ...]:
    names = section.texts(key)
    doubled = [name for name in names if name != SKIPPED and names.count(name) > 1]
    if doubled:
        raise Refusal(f"{section.source}: '{key}' has '{doubled[0]}' twice", fault="twice")
    if all(name == SKIPPED for name in names):
        raise Refusal(f"{section.source}: '{key}' names no column", fault="too_few")
    return names
