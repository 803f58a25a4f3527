"""Writes files whole or not at all, and makes the folders for them."""

import io
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryFile

from stepdiag_ros.metrology.refusal import Refusal

FORCE = "name another file, or overwrite by --force"
_HEAD = 65_536
"""Bytes that are read of a file to see its kind."""
_ELSEWHERE = "name another one with --output FOLDER"


def make_folder(folder: Path) -> Path:
    """Make sure that a folder for results is there, and return it.

    Raises:
        ValueError: it cannot be made or written to; names the folder.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise ValueError(f"{folder} is a file; results need a folder") from None
    except OSError as error:
        raise ValueError(
            f"the folder {folder} cannot be made: {error.strerror}; {_ELSEWHERE}"
        ) from None
    if not os.access(folder, os.W_OK | os.X_OK):
        raise ValueError(f"the folder {folder} cannot be written to; {_ELSEWHERE}")
    return folder


def try_folder(folder: Path) -> None:
    """Make sure, before any work, that results can be written; leave nothing behind.

    Raises:
        ValueError: the folder cannot be made or written to; names the folder.
    """
    made = [one for one in (folder, *folder.parents) if not one.exists()]
    try:
        make_folder(folder)
        with TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise ValueError(
            f"the folder {folder} cannot be written to: {error.strerror}; {_ELSEWHERE}"
        ) from None
    finally:
        for one in made:
            with suppress(OSError):
                one.rmdir()


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Give a name to write to and rename it at the end: no half-written file is ever found."""
    partial = path.with_name(f".partial-{path.name}")
    try:
        yield partial
        partial.replace(path)
    except OSError as error:
        # A full disk is told without the name of any file.
        raise OSError(error.errno, error.strerror, str(path)) from error
    finally:
        partial.unlink(missing_ok=True)


def write_new(files: Mapping[Path, bytes], overwrite: bool = False, remedy: str = FORCE) -> None:
    """Write files, each whole or not at all; nothing is written if one of them is refused.

    Args:
        files: path → content.
        overwrite: see ``check_new``.
        remedy: see ``check_new``.

    Raises:
        Refusal: a file is there already, or its folder is not.
        OSError: a file cannot be written.
    """
    check_new(files, overwrite, remedy)
    for path, content in files.items():
        with whole_file(path) as partial:
            partial.write_bytes(content)


def check_new(paths: Iterable[Path], overwrite: bool = False, remedy: str = FORCE) -> None:
    """Refuse, before any work, what could not be written after it.

    Args:
        paths: of files that belong together.
        overwrite: files that are there may be written over.
        remedy: for a file that is there.

    Raises:
        Refusal: a file is there already, its folder is not, or two files have the same name.
    """
    seen: set[Path] = set()
    for path in paths:
        if path.is_dir():
            raise Refusal(f"{path} is a folder; name a file", fault="mismatch")
        if path.exists() and not overwrite:
            raise Refusal(f"{path} is there already; {remedy}", fault="exists")
        if not path.parent.is_dir():
            raise Refusal(f"there is no folder {path.parent}; make it first", fault="not_found")
        if path.resolve() in seen:
            raise Refusal(
                f"two files would be called {path}; name one of them otherwise", fault="mismatch"
            )
        seen.add(path.resolve())


def refuse_foreign(path: Path, ours: re.Pattern[bytes], kind: str) -> None:
    """Refuse, before any work, to replace a file that is no earlier one of the same kind.

    Args:
        path: of the file to be written.
        ours: what the head of every earlier one contains.
        kind: what it is, in words.

    Raises:
        Refusal: a file with other content is there already, or a folder.
    """
    if path.is_dir():
        raise Refusal(
            f"{path} is a folder; name a file", fault="wrong_kind", about=kind, where=str(path)
        )
    if not path.is_file():
        return
    with path.open("rb") as stream:
        head = stream.read(_HEAD)
    if head and not ours.search(head):
        raise Refusal(
            f"{path} is there already and is not a {kind}; it is not replaced. Name another file",
            fault="exists",
            about=kind,
            where=str(path),
        )


def without_trailing_blanks(text: str) -> str:
    """Return a text without blanks at the ends of its lines, which line feeds alone end."""
    # Not splitlines(): it would make a line break of a sign within a name or a JSON string.
    return "".join(f"{line.rstrip()}\n" for line in io.StringIO(text))
