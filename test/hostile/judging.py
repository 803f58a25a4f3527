"""Runs commands on a changed bag in a process of its own, and judges what they made of it.

A command may refuse (exit code 1 and one sentence that names the file), say in words what is wrong
with the recording, or give the same numbers as from the bag that nobody has changed.
"""

import contextlib
import io
import json
import os
import pickle
import resource
import select
import shutil
import signal
import sys
import time
import traceback
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from stepdiag_ros.cli import main
from stepdiag_ros.text.sentence import PREFIX

LIMIT_SECONDS = 20
"""Of processor time for all commands of a case; _PATIENCE times as much without the processor."""
_PATIENCE = 10
MEMORY_FACTOR, MEMORY_BASE = 4, 200_000_000
_ADDRESS_SPACE = 3_000_000_000
"""Bytes that a case may map beyond what was mapped before, so that the computer survives it."""
_LONGEST_SENTENCE = 2000
QUICK = ("info", "export", "recover")
SLOW = ("solve", "compensate", "report")
COMMANDS = (*QUICK, *SLOW)


@dataclass
class Outcome:
    """What a command made of a bag.

    Attributes:
        code: exit code; None if an exception came out of the command.
        numbers: everything that it tells of the run, without names of files and times of writing.
        words: that something is wrong with the recording.
        fault: why this is no way to end; empty if it is one.
    """

    code: int | None = None
    numbers: Any = None
    words: list[str] = field(default_factory=list)
    fault: str = ""


@dataclass
class Case:
    """What came of one bag: by command; processor time (s) and memory (bytes) of all of them."""

    outcomes: dict[str, Outcome]
    seconds: float
    memory: int
    fault: str = ""


def examined(path: Path, folder: Path, commands: Sequence[str]) -> Case:
    """Run commands on a bag in a child process, one after another, each in a bounded time."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            os.close(reading)
            _work(path, folder, commands, writing)
        finally:
            os._exit(0)  # whatever happens, a child does not go on with what its parent does
    os.close(writing)
    before, content, hung = _heard(reading, len(commands), child)
    if hung:
        os.kill(child, signal.SIGKILL)
    _, status, usage = os.wait4(child, 0)
    seconds = usage.ru_utime + usage.ru_stime
    case = Case({}, seconds, max(usage.ru_maxrss * 1024 - before, 0))
    for name, outcome in content:
        case.outcomes[name] = outcome
        if outcome.fault and not case.fault:
            case.fault = f"{name}: {outcome.fault}"
    if hung or os.WTERMSIG(status) == signal.SIGXCPU:
        case.fault = f"{commands[len(content)]}: no end within {LIMIT_SECONDS} s"
    elif status:
        case.fault = f"{commands[len(content)]}: the process died (status {status})"
    bound = MEMORY_FACTOR * path.stat().st_size + MEMORY_BASE
    if not case.fault and case.memory > bound:
        case.fault = f"{case.memory / 1e6:.0f} MB for a bag of {path.stat().st_size / 1e6:.2f} MB"
    return case


def differences(case: Case, whole: Case) -> str:
    """Say which command gives other numbers than of the whole bag and says nothing of it."""
    for name, outcome in case.outcomes.items():
        known = whole.outcomes[name]
        if outcome.code == 0 and not outcome.words and outcome.numbers != known.numbers:
            return f"{name}: other numbers and no word: {_where(known.numbers, outcome.numbers)}"
    return ""


def _heard(reading: int, count: int, child: int) -> tuple[int, list[tuple[str, Outcome]], bool]:
    """Return what the child had in memory before, what came of its commands, and if it hung."""
    content: list[Any] = []
    begun, hung = time.monotonic(), False
    with os.fdopen(reading, "rb") as pipe:
        while len(content) <= count and not hung:
            if not select.select([pipe], [], [], LIMIT_SECONDS)[0]:
                # Time in which others had the processor is none of the child's.
                waited = int(Path(f"/proc/{child}/schedstat").read_text().split()[1]) * 1e-9
                hung = time.monotonic() - begun - waited > _PATIENCE * LIMIT_SECONDS
                continue
            try:
                content.append(pickle.load(pipe))
            except EOFError:
                break
    return content[0] if content else 0, content[1:], hung


def _work(path: Path, folder: Path, commands: Sequence[str], writing: int) -> None:
    mapped, resident = (
        int(pages) * resource.getpagesize()
        for pages in Path("/proc/self/statm").read_text().split()[:2]
    )
    resource.setrlimit(resource.RLIMIT_AS, (mapped + _ADDRESS_SPACE,) * 2)
    # A child's processor time counts from its fork.
    resource.setrlimit(resource.RLIMIT_CPU, (LIMIT_SECONDS, LIMIT_SECONDS + 1))
    with os.fdopen(writing, "wb") as pipe:
        pickle.dump(resident, pipe)
        for name in commands:
            pickle.dump((name, _outcome(name, path, folder / name)), pipe)
            pipe.flush()


def _outcome(name: str, path: Path, folder: Path) -> Outcome:
    shutil.rmtree(folder, ignore_errors=True)
    made = Outcome()
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            made.code = main(_arguments(name, path, folder))
        except Exception as error:
            frames = traceback.extract_tb(error.__traceback__)
            own = [one for one in frames if "stepdiag_ros" in one.filename] or list(frames)
            place = f"{Path(own[-1].filename).name}:{own[-1].lineno}"
            made.fault = f"{type(error).__name__} at {place}: {str(error)[:100]}"
            return made
    made.fault = _bad_words(made.code, err.getvalue(), out.getvalue(), path)
    if not made.fault and made.code == 0:
        try:
            made.numbers, made.words = _told(name, out.getvalue(), err.getvalue(), folder)
        except (ValueError, KeyError, OSError) as error:
            made.fault = f"what it wrote cannot be read: {type(error).__name__} {error}"
    return made


def _bad_words(code: int | None, said: str, shown: str, path: Path) -> str:
    lines = said.splitlines()
    odd = [line for line in lines if "Warning" in line or "Traceback" in line]
    if odd:
        return f"said on standard error: {odd[0][:150]}"
    control = [one for one in said if not one.isprintable() and one != "\n"]
    control += [one for one in shown if unicodedata.category(one) == "Cc" and one != "\n"]
    if control:
        return f"control character {control[0]!r} to the terminal"
    if code == 0:
        return ""
    if code != 1 or not lines or not lines[-1].startswith(PREFIX):
        return f"exit code {code} without a sentence"
    if path.stem not in lines[-1]:
        return f"the sentence does not name the file: {lines[-1][:150]}"
    if len(lines[-1]) > _LONGEST_SENTENCE:
        return f"a sentence of {len(lines[-1])} characters: {lines[-1][:100]}"
    return ""


def _arguments(name: str, path: Path, folder: Path) -> list[str]:
    folder.parent.mkdir(parents=True, exist_ok=True)
    if name == "recover":
        folder.mkdir()
    return {
        "info": ["info", str(path), "--json"],
        "export": ["export", str(path), "--output", str(folder), "--readings", "--json"],
        "recover": ["recover", str(path), str(folder / f"{path.stem}_whole.mcap"), "--json"],
        "solve": ["solve", str(path), "--json", "--pictures", "none", "--output", str(folder)],
        "compensate": [
            *("compensate", str(path), "--for", "generic", "--pictures", "none"),
            *("--output", str(folder)),
        ],
        "report": ["report", str(path), "--json", "--output", str(folder)],
    }[name]


def _told(name: str, shown: str, said: str, folder: Path) -> tuple[Any, list[str]]:
    """Return what a command tells of a run, and what it says of the recording."""
    if name == "compensate":
        words = [line for line in said.splitlines() if "recording" in line]
        table = (folder / "error_grid.csv").read_text().splitlines()
        return [line for line in table if not line.startswith("#")], words
    if name == "export":
        files = {file.name: file.read_text() for file in sorted(folder.iterdir())}
        return files, json.loads(shown)["remarks"]
    if name == "report":
        document = json.loads((folder / "report.json").read_text())
        return _numbers(document), _words(document["summary"])
    document = json.loads(shown)
    if name == "solve":
        return _numbers(document), _words(document["lead"])
    if name == "info":
        return _numbers(document), _words(document)
    return document["topics"], document["losses"]


def _words(told: dict[str, Any]) -> list[str]:
    return [one["sentence"] for one in told.get("recording", [])]


_OF_THE_FILE = (
    *("path", "bag", "size", "chunks", "data_checksum", "next", "sha256", "written", "source"),
    *("created", "date", "file", "run_sha256", "equals_recorded"),
)


def _numbers(document: Any) -> Any:
    """Return a document without what names the file or the time of writing."""
    if isinstance(document, dict):
        return {k: _numbers(v) for k, v in document.items() if k not in _OF_THE_FILE}
    if isinstance(document, list):
        return [_numbers(one) for one in document]
    return document


def _where(known: Any, found: Any, place: str = "") -> str:
    if isinstance(known, dict) and isinstance(found, dict):
        for key in (*known, *found):
            if known.get(key) != found.get(key):
                return _where(known.get(key), found.get(key), f"{place}.{key}")
    if isinstance(known, list) and isinstance(found, list) and len(known) == len(found):
        for number, (a, b) in enumerate(zip(known, found, strict=True)):
            if a != b:
                return _where(a, b, f"{place}[{number}]")
    return f"{place} is {str(found)[:60]!r} instead of {str(known)[:60]!r}"


def warm_up(path: Path, folder: Path) -> None:
    """Run every command once in this process, so that no child has to import anything."""
    for name in COMMANDS:
        outcome = _outcome(name, path, folder / name)
        if outcome.code != 0 or outcome.fault:
            sys.exit(f"{name} of the whole bag: {outcome.fault or 'refused'}")
