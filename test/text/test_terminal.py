"""On a terminal a line ends between two words; in a file a sentence is one line."""

import io
import os
import pty
import struct
import termios
from fcntl import ioctl

import pytest

from stepdiag_ros.commands.output import say
from stepdiag_ros.text.console import make_console
from stepdiag_ros.text.terminal import columns, fitted

END = "\x04"
PATH = "a/path/that-is-longer/than-the-terminal/is-wide/run.mcap"


@pytest.fixture
def terminal():
    """Return a stream that is a terminal of 40 columns, and what was written to it."""
    reader, writer = pty.openpty()
    ioctl(writer, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 40, 0, 0))
    stream = os.fdopen(writer, "w")

    def written():
        # The mark is the last that comes through, in however many pieces.
        stream.write(END)
        stream.flush()
        text = b""
        while not text.endswith(END.encode()):
            text += os.read(reader, 10000)
        return text.decode().removesuffix(END).replace("\r\n", "\n")

    yield stream, written
    stream.close()
    os.close(reader)


def test_no_word_is_broken_and_none_is_lost():
    text = f"readings of {PATH} are stamped late by -0.05 µs\nand one more line"
    lines = fitted(text, 40, "  ").split("\n")
    assert " ".join(lines).split() == text.split()
    assert PATH in [line.strip() for line in lines]
    assert all(len(line) <= 40 or line.strip() == PATH for line in lines)
    assert fitted(text, None) == text
    assert fitted("a\n\nb", 40) == "a\n\nb"


def test_what_is_no_terminal_has_no_columns(tmp_path, terminal):
    stream, _ = terminal
    assert columns(stream) == 40
    assert columns(io.StringIO()) is None
    with (tmp_path / "file").open("w") as file:
        assert columns(file) is None


def test_what_is_said_beside_a_result_fits_the_terminal(monkeypatch, terminal):
    stream, written = terminal
    monkeypatch.setattr("sys.stderr", stream)
    say("results in this folder: " + ", ".join(f"picture_{n}.png" for n in range(8)))
    make_console(stream).sentence("Timing:    " + "word " * 20, indent=" " * 11)
    lines = written().splitlines()
    assert len(lines) > 6
    assert max(map(len, lines)) <= 40
    begin = next(n for n, line in enumerate(lines) if line.startswith("Timing:"))
    assert len(lines) > begin + 2
    assert all(line.startswith(" " * 11) for line in lines[begin + 1 :])
