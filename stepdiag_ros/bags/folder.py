"""A bag that is a folder, as ``ros2 bag record`` leaves it: metadata.yaml and one or more files."""

import re
from collections.abc import Collection, Iterator
from functools import cached_property
from heapq import merge
from itertools import chain
from pathlib import Path
from typing import Any

from stepdiag_ros.bags.bag import Bag, Order, Payloads, RecordedMessage
from stepdiag_ros.bags.errors import BagError
from stepdiag_ros.bags.reader import BagReader
from stepdiag_ros.bags.tally import Flaw
from stepdiag_ros.text.intake import parse_yaml
from stepdiag_ros.text.sentence import sentence

METADATA_FILE = "metadata.yaml"
SUFFIXES = (".mcap", ".mcap.zstd")


def open_bag(path: str | Path) -> Bag:
    """Open a bag for reading: an MCAP file, or a folder of ``ros2 bag record``.

    Raises:
        BagError: not there, or no bag.
        BagCutError: the end is missing.
        BagCorruptError: a checksum is wrong; the text names the offset.
    """
    path = Path(path)
    return FolderReader(path) if path.is_dir() else BagReader(path)


class FolderReader(Bag):
    """A complete bag in a folder.

    Args:
        path: the folder.

    Raises:
        BagError: it holds no MCAP file, or one that its metadata.yaml names is missing.
        BagCutError: the end of a file is missing.
        BagCorruptError: a checksum is wrong; the text names file and offset.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._parts: list[BagReader] = []
        try:
            for file in _files(self.path):
                self._parts.append(BagReader(file))
        except BaseException:
            self.close()
            raise
        self.metadata = {}
        self.attachments = []
        for part in self._parts:
            self.metadata.update(part.metadata)
            self.attachments += part.attachments

    def close(self) -> None:
        """Close all files; harmless when called again."""
        for part in self._parts:
            part.close()

    @property
    def size(self) -> int:
        """Return the size of all files in bytes."""
        return sum(part.size for part in self._parts)

    @property
    def has_data_checksum(self) -> bool:
        """Say whether a checksum covers all of each file."""
        return all(part.has_data_checksum for part in self._parts)

    @property
    def chunk_count(self) -> int:
        """Return the number of chunks in all files."""
        return sum(part.chunk_count for part in self._parts)

    @cached_property
    def topics(self) -> dict[str, str]:
        """Return the full names of the topics and their types, in the order of first recording."""
        found: dict[str, str] = {}
        for part in self._parts:
            for name, type_name in part.topics.items():
                if found.setdefault(name, type_name) != type_name:
                    raise BagError(
                        f"{part.path}: topic {name} has type {type_name}, in the files before it"
                        f" {found[name]}; these files are not of one recording"
                    )
        return found

    @cached_property
    def start_time(self) -> int:
        """Return the first log time, ns; 0 without messages."""
        return min((part.start_time for part in self._parts if part.chunk_count), default=0)

    @cached_property
    def end_time(self) -> int:
        """Return the last log time, ns; 0 without messages."""
        return max((part.end_time for part in self._parts if part.chunk_count), default=0)

    def flaws(self) -> tuple[Flaw, ...]:
        """Say what is wrong with the recording in each file; see ``Bag``."""
        return tuple(flaw for part in self._parts for flaw in part.flaws())

    def definitions(self) -> dict[str, str]:
        """Return type → text of its definition; see ``Bag``."""
        texts: dict[str, str] = {}
        for part in self._parts:
            for type_name, text in part.definitions().items():
                if texts.setdefault(type_name, text) != text:
                    raise BagError(
                        f"{part.path}: {type_name} is defined otherwise than in the files before"
                        " it; these files are not of one recording"
                    )
        return texts

    def records(
        self,
        order: Order = "file",
        topics: Collection[str] | None = None,
        start: int | None = None,
        end: int | None = None,
    ) -> Iterator[RecordedMessage]:
        """Go through the recorded messages of all files; see ``Bag``."""
        wanted = [part.records(order, topics, start, end) for part in self._parts]
        if order == "time":
            return merge(*wanted, key=lambda record: record.log_time)
        return chain.from_iterable(wanted)

    def payloads(self, topic: str) -> Iterator[Payloads]:
        """Go through the messages of one topic of all files; see ``Bag``."""
        return chain.from_iterable(part.payloads(topic) for part in self._parts)


def _files(folder: Path) -> list[Path]:
    """Return the MCAP files of a bag in the order of recording."""
    description = folder / METADATA_FILE
    if not description.is_file():
        # What was not closed has no metadata.yaml; the names tell the order.
        found = [file for file in folder.iterdir() if file.name.endswith(SUFFIXES)]
        if not found:
            below = {one.parent for suffix in SUFFIXES for one in folder.glob(f"*/*{suffix}")}
            hint = f"; give the bag in it, {below.pop()}" if len(below) == 1 else ""
            raise BagError(
                f"{folder} is not a bag: there is neither {METADATA_FILE} nor an MCAP file{hint}",
                fault="wrong_kind",
            )
        stems = {re.sub(r"(_\d+)?\.mcap(\.zstd)?$", "", file.name) for file in found}
        if len(stems) > 1:
            raise BagError(
                f"{folder} holds several bags, such as {found[0].name} and {found[-1].name};"
                " name one of them",
                fault="ambiguous",
                aspect="bag",
            )
        return sorted(found, key=_place)
    told = _told(description)
    storage = told.get("storage_identifier")
    if storage != "mcap":
        raise BagError(
            f"{folder} is recorded as '{storage}', which cannot be read; record with"
            " 'ros2 bag record -s mcap', or convert it with 'ros2 bag convert'",
            fault="wrong_kind",
        )
    names = told.get("relative_file_paths")
    if not isinstance(names, list) or not names:
        raise BagError(f"{description}: 'relative_file_paths' names no file")
    if len(set(map(str, names))) < len(names):
        raise BagError(f"{description}: 'relative_file_paths' names a file twice")
    return [folder / str(name) for name in names]


def _told(description: Path) -> dict[str, Any]:
    try:
        parsed = parse_yaml(description.read_text(encoding="utf-8"), str(description))
    except (OSError, ValueError) as error:
        raise BagError(
            f"{description} cannot be read: {sentence(error)}", fault="unreadable"
        ) from None
    told = parsed.get("rosbag2_bagfile_information") if isinstance(parsed, dict) else None
    if not isinstance(told, dict):
        raise BagError(
            f"{description} is not a description of a bag of ros2 bag record", fault="malformed"
        )
    return told


def _place(file: Path) -> int:
    number = re.search(r"_(\d+)\.mcap", file.name)
    return int(number.group(1)) if number else 0
