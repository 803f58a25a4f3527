"""Driver ``file_tail``: an interferometer whose own program writes its readings to a text file.

The file is followed as it grows, like ``tail -F``: from its end at the start, through truncation,
and through rotation (another file of that name). What a program of the maker writes is often held
back by its buffer; then only a time in the file shows when a reading was measured.
"""

import os
from collections.abc import Callable, Mapping
from io import FileIO
from pathlib import Path
from typing import Any

from stepdiag_ros.devices import Surroundings
from stepdiag_ros.devices.interferometer.messages import InstrumentSettings, MessageInterferometer
from stepdiag_ros.devices.link_framing import FramingSettings
from stepdiag_ros.metrology.checking import Section
from stepdiag_ros.metrology.refusal import Silent, Unusable
from stepdiag_ros.metrology.units import NANOSECONDS

MOST_AT_ONCE = 1 << 20
"""Bytes that are taken from the file in one look."""
LOOK_AGAIN = NANOSECONDS // 10
"""ns between two looks whether the file has been replaced by another one."""


class GrowingFile:
    """The messages of a file, as they are added to it (protocol: ``messages.Source``).

    Args:
        path: of the file.
        framing: of its messages.
        silence: ns for which nothing may be added; 0: for ever.
        from_start: begin with what is in the file already.
        time_ns: now.

    Raises:
        OSError: it cannot be read.
    """

    def __init__(
        self, path: Path, framing: FramingSettings, silence: int, from_start: bool, time_ns: int
    ) -> None:
        self._path = path
        self._framing_settings = framing
        self._silence = silence
        self._file: FileIO
        self._open()
        if not from_start:
            self._file.seek(0, os.SEEK_END)
        self._heard = self._looked = time_ns

    def poll(self, time_ns: int) -> list[bytes]:
        """Return the messages that were added since the last call, in order.

        Raises:
            OSError: the file is gone, or nothing has been added for too long.
            ValueError: what was added has no end where there should be one.
        """
        messages = self._take()
        if time_ns - self._looked >= LOOK_AGAIN:
            self._looked = time_ns
            messages += self._follow()
        if messages:
            self._heard = time_ns
        elif self._silence and time_ns - self._heard > self._silence:
            raise Silent(
                f"{self._path} has not grown for {self._silence / NANOSECONDS:g} s",
                fault="silent",
            )
        return messages

    def zero(self) -> None:
        """Nobody can be asked through a file."""

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _open(self) -> None:
        try:
            self._file = FileIO(self._path)
        except OSError as error:
            raise Unusable(
                f"{self._path} cannot be read: {error.strerror}", fault="unreadable"
            ) from None
        self._framing = self._framing_settings.make()

    def _take(self) -> list[bytes]:
        data = self._file.read(MOST_AT_ONCE)
        return self._framing.take(data) if data else []

    def _follow(self) -> list[bytes]:
        """Go on with another file of that name, or from the start of one that was cut off."""
        here = os.fstat(self._file.fileno())
        try:
            there = self._path.stat()
        except FileNotFoundError:
            # Between two files; silence tells if there never is another one.
            return []
        if (there.st_dev, there.st_ino) != (here.st_dev, here.st_ino):
            rest = self._take()
            self._file.close()
            self._open()
            return rest + self._take()
        if here.st_size < self._file.tell():
            self._file.seek(0)
            self._framing = self._framing_settings.make()
            return self._take()
        return []


def from_settings(
    settings: Mapping[str, Any],
    surroundings: Surroundings,  # noqa: ARG001
) -> Callable[[int], MessageInterferometer]:
    """Return what begins to follow the file at a time, ns.

    Settings: ``path``, ``silence_s`` (default 10; 0: for ever), ``from_start`` (default false: what
    is in the file already was measured before), ``framing`` (lines), and those of
    ``messages.InstrumentSettings``.

    Raises:
        ValueError: a setting is wrong.
    """
    section = Section(settings, "settings of the interferometer")
    path = Path(section.text("path")).expanduser()
    silence = round(NANOSECONDS * section.number("silence_s", low=0.0, high=86400.0, default=10.0))
    from_start = section.flag("from_start", default=False)
    framing = FramingSettings.from_section(section.section("framing"))
    instrument = InstrumentSettings.from_section(section)
    section.finish()

    def follow(start: int) -> MessageInterferometer:
        source = GrowingFile(path, framing, silence, from_start, start)
        return MessageInterferometer(instrument, source, start)

    return follow
