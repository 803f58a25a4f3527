"""Where an archive is: a folder, or whatever else fsspec can list, read and write."""

import os
import shutil
import tempfile
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Any, BinaryIO, cast

import fsspec

from stepdiag_ros.metrology.refusal import Refusal

_PARTIAL = "partial"
"""Folder of what is being written. On a file system it is renamed when it is whole."""


class Place:
    """A tree of files, each of which is there whole or not at all.

    Args:
        url: a folder, or a URL that fsspec understands, such as ``s3://bucket/archive``.

    Attributes:
        url: as given; another process opens the same place by it.

    Raises:
        ValueError: fsspec does not know the protocol, or lacks the library for it.
    """

    def __init__(self, url: str) -> None:
        self.url = url
        try:
            self._fs, root = fsspec.core.url_to_fs(url)
        except (ValueError, ImportError) as error:
            raise Refusal(f"{url} cannot be opened: {error}", fault="unsupported") from None
        self._root = str(root).rstrip("/")
        self.is_local = "file" in _protocols(self._fs)

    @property
    def file_system(self) -> Any:
        """Return the file system of fsspec, for a library that reads by it."""
        return self._fs

    def address(self, name: str) -> str:
        """Return what DuckDB reads a file by: a path, or a URL."""
        path = f"{self._root}/{name}"
        return path if self.is_local else str(self._fs.unstrip_protocol(path))

    def exists(self, name: str) -> bool:
        """Say whether there is a file of this name."""
        return bool(self._fs.isfile(f"{self._root}/{name}"))

    def names(self, folder: str) -> list[str]:
        """Return the files in a folder and below it, as names in the place, in order."""
        start, top = len(self._root) + 1, f"{self._root}/{folder}"
        if self.is_local:
            # Names alone: fsspec asks for, and holds, all that is known of each file.
            paths = (f"{at}/{file}" for at, _, files in os.walk(top) for file in files)
            return sorted(path[start:] for path in paths)
        self._fs.invalidate_cache()
        return sorted(str(path)[start:] for path in self._fs.find(top))

    def read(self, name: str) -> bytes:
        """Return the bytes of a file.

        Raises:
            OSError: it is not there, or cannot be read.
        """
        return bytes(self._fs.cat_file(f"{self._root}/{name}"))

    @contextmanager
    def opened(self, name: str) -> Iterator[BinaryIO]:
        """Open a file for reading, a piece at a time."""
        with self._fs.open(f"{self._root}/{name}", "rb") as file:
            yield file

    def put(self, source: Path, name: str) -> None:
        """Copy a file into the place; it is there only when it is whole.

        Raises:
            OSError: it cannot be read or written.
        """
        target = f"{self._root}/{name}"
        if not self.is_local:
            # A store shows an object when all of it has arrived.
            self._fs.put_file(str(source), target)
            return
        partial = Path(self._root) / _PARTIAL / uuid.uuid4().hex
        partial.parent.mkdir(parents=True, exist_ok=True)
        try:
            with source.open("rb") as given, partial.open("xb") as taken:
                shutil.copyfileobj(given, taken, 2**20)
                taken.flush()
                os.fsync(taken.fileno())
            Path(target).parent.mkdir(parents=True, exist_ok=True)
            partial.replace(target)
        finally:
            partial.unlink(missing_ok=True)

    def remove(self, name: str) -> None:
        """Remove a file; harmless if it is gone already."""
        try:
            self._fs.rm_file(f"{self._root}/{name}")
        except FileNotFoundError:
            return

    @contextmanager
    def as_local(self, name: str) -> Iterator[Path]:
        """Give the path of a file under its own name, of a copy where the place is elsewhere."""
        if self.is_local:
            yield Path(self._root) / name
            return
        with tempfile.TemporaryDirectory() as folder:
            copy = Path(folder) / name.rpartition("/")[2]
            self._fs.get_file(f"{self._root}/{name}", str(copy))
            yield copy

    def written(self, name: str) -> datetime:
        """Return when a file was written, UTC."""
        return cast(datetime, self._fs.modified(f"{self._root}/{name}"))

    def leftovers(self) -> list[str]:
        """Return the names of files that were being written when their process was killed."""
        return self.names(_PARTIAL) if self.is_local else []


def _protocols(file_system: Any) -> tuple[str, ...]:
    told = file_system.protocol
    return (told,) if isinstance(told, str) else tuple(told)
