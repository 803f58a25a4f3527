"""Writes a run into one MCAP file, so that a crash costs the block in progress at most.

The file is streamed under its final name. Identity, plan and models stand in front of all messages.
Chunks are small and go to the operating system as soon as they are full; ``flush`` ends the chunk
and waits until it is on the disk.
"""

import errno
import os
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any, TypeVar

import yaml
from mcap.writer import CompressionType, Writer

from stepdiag_ros.bags.errors import BagError, BagWriteError
from stepdiag_ros.bags.header import METADATA_NAME, RunHeader
from stepdiag_ros.bags.tally import COUNTS_METADATA, LIBRARY
from stepdiag_ros.bags.types import own_types
from stepdiag_ros.topics import Qos, Topic, topic_of

CHUNK_SIZE = 32 * 1024
PROFILE = "ros2"
MESSAGE_ENCODING = "cdr"
SCHEMA_ENCODING = "ros2msg"

_FOREVER = "{sec: 9223372036, nsec: 854775807}"
_FOREIGN = Topic("", "", Qos.COMMAND)
"""Quality of service that is stated for a topic from outside the suite."""
Result = TypeVar("Result")


class UnbufferedFile:
    """A new file whose writes go straight to the operating system.

    The MCAP writer hands over whole records, so a buffer of Python's would only add bytes that die
    with the process. A write that the system takes in part is continued here.
    """

    def __init__(self, path: Path) -> None:
        self._file = path.open("xb", buffering=0)
        self._position = 0

    def write(self, data: bytes) -> int:
        """Write all of the data; raises ``OSError``."""
        view = memoryview(data)
        while view:
            written = self._file.write(view)
            self._position += written
            view = view[written:]
        return len(data)

    def tell(self) -> int:
        """Return how many bytes were written."""
        return self._position

    def flush(self) -> None:
        """Do nothing: there is no buffer."""

    def sync(self) -> None:
        """Wait until everything is on the disk."""
        os.fsync(self._file.fileno())

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def mcap_writer(file: UnbufferedFile, chunk_size: int, compress: bool) -> Writer:
    """Return an MCAP writer into a file, with all checksums on."""
    stream: Any = file  # has what the writer uses of a stream
    return Writer(
        stream,
        chunk_size=chunk_size,
        compression=CompressionType.ZSTD if compress else CompressionType.NONE,
        enable_crcs=True,
        enable_data_crcs=True,
    )


class BagWriter:
    """One bag that is being written. Use from one thread; a context manager closes it.

    Args:
        path: the new file, by custom ``NAME.mcap``.
        header: identity of the run and its texts, written first.
        chunk_size: bytes of messages after which a chunk is ended.
        compress: compress chunks with zstd.

    Raises:
        BagError: the file exists already, or its folder does not.
        BagWriteError: it cannot be written.
    """

    def __init__(
        self,
        path: str | Path,
        header: RunHeader,
        *,
        chunk_size: int = CHUNK_SIZE,
        compress: bool = True,
    ) -> None:
        self.path = Path(path)
        self.message_count = 0
        self._failure: BagWriteError | None = None
        self._closed = False
        self._channels: dict[str, tuple[int, str]] = {}
        self._counts: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        try:
            self._file = UnbufferedFile(self.path)
        except FileExistsError:
            raise BagError(
                f"{self.path} exists already; a bag is never overwritten", fault="exists"
            ) from None
        except FileNotFoundError:
            raise BagError(
                f"{self.path}: the folder {self.path.parent} does not exist", fault="not_found"
            ) from None
        except OSError as error:
            raise BagWriteError(f"{self.path} cannot be written: {error.strerror}") from error
        self._mcap = mcap_writer(self._file, chunk_size, compress)
        try:
            self._guarded(lambda: self._write_header(header))
            _sync_folder(self.path.parent)
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> "BagWriter":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if self._failure is None:
            self.close()
        else:
            self._abandon()

    def write(
        self,
        topic: str,
        type_name: str,
        cdr: bytes,
        log_time: int,
        publish_time: int | None = None,
        sequence: int | None = None,
    ) -> None:
        """Add one message.

        Args:
            topic: full name.
            type_name: for example ``stepdiag_ros/msg/RunState``.
            cdr: serialised message with its encapsulation.
            log_time: when it was received, ns.
            publish_time: when it was sent, ns; the log time if not known.
            sequence: of the publisher; None: the number of the message on its topic, from 1, by
                which a reader sees that one is missing.

        Raises:
            BagError: the topic has another type, the type is not known, or the bag is closed.
            BagWriteError: the disk is full or gone.
        """
        self._require_open()
        known = self._channels.get(topic)
        if known is None:
            known = self._guarded(lambda: self._register(topic, type_name))
        channel, known_type = known
        if known_type != type_name:
            raise BagError(
                f"{self.path}: topic {topic} has type {known_type}; "
                f"a message of {type_name} does not fit",
                fault="mismatch",
            )
        count = self._counts[topic] + 1
        try:  # not by _guarded: this runs a thousand times a second
            self._mcap.add_message(
                channel,
                log_time=log_time,
                data=cdr,
                publish_time=log_time if publish_time is None else publish_time,
                sequence=(count if sequence is None else sequence) & 0xFFFFFFFF,
            )
        except OSError as error:
            raise self._failed(error) from error
        self._counts[topic] = count
        self.message_count += 1

    def flush(self) -> None:
        """End the chunk in progress and wait until everything written so far is on the disk.

        Raises:
            BagError: the bag is closed.
            BagWriteError: the disk is full or gone.
        """
        self._require_open()
        self._guarded(self._flush)

    def close(self) -> None:
        """Write the summary and close the file; harmless when called again.

        Raises:
            BagWriteError: the disk is full or gone.
        """
        if self._closed:
            return
        if self._failure is not None:
            self._abandon()
            raise self._failure
        try:
            self._guarded(self._finish)
        finally:
            self._abandon()

    def _write_header(self, header: RunHeader) -> None:
        self._mcap.start(profile=PROFILE, library=f"{LIBRARY} {header.software_version}")
        self._mcap.add_metadata("rosbag2", _rosbag2_record(header.start_time))
        self._mcap.add_metadata(METADATA_NAME, header.metadata())
        for attachment in header.attachments():
            self._mcap.add_attachment(
                create_time=header.start_time,
                log_time=header.start_time,
                name=attachment.name,
                media_type=attachment.media_type,
                data=attachment.data,
            )
        self._file.sync()

    def _register(self, topic: str, type_name: str) -> tuple[int, str]:
        types = own_types()
        if type_name not in self._schemas:
            text = types.schema(type_name).encode()
            self._schemas[type_name] = self._mcap.register_schema(type_name, SCHEMA_ENCODING, text)
        found = topic_of(topic)
        known = _FOREIGN if found is None else found[0]
        channel = self._mcap.register_channel(
            topic,
            MESSAGE_ENCODING,
            self._schemas[type_name],
            {
                "offered_qos_profiles": offered_qos_profiles(known),
                "topic_type_hash": types.type_hash(type_name),
            },
        )
        self._channels[topic] = (channel, type_name)
        self._counts[topic] = 0
        return self._channels[topic]

    def _flush(self) -> None:
        self._mcap.flush()  # type: ignore[no-untyped-call]
        self._file.sync()

    def _finish(self) -> None:
        counts = {topic: str(count) for topic, count in self._counts.items()}
        self._mcap.add_metadata(COUNTS_METADATA, counts)
        self._mcap.finish()  # type: ignore[no-untyped-call]
        self._file.sync()

    def _require_open(self) -> None:
        if self._failure is not None:
            raise self._failure
        if self._closed:
            raise BagError(f"{self.path} is closed; nothing can be added", fault="stopped")

    def _guarded(self, action: Callable[[], Result]) -> Result:
        try:
            return action()
        except OSError as error:
            raise self._failed(error) from error

    def _failed(self, error: OSError) -> BagWriteError:
        full = error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
        reason = "the disk is full" if full else f"writing failed ({error.strerror})"
        # Nothing more is written: bytes behind a torn record could not be found again.
        self._failure = BagWriteError(
            f"{self.path}: {reason}; what was recorded before stays readable: "
            f"stepdiag recover {self.path}"
        )
        return self._failure

    def _abandon(self) -> None:
        self._closed = True
        self._file.close()


def _rosbag2_record(start_time: int) -> dict[str, str]:
    """Return what rosbag2 looks for in an MCAP file.

    Humble takes the numbers in offered_qos_profiles because ROS_DISTRO is there, later versions
    because the version stated here is one that had numbers. Times, counts, topics and files it
    takes from the file's summary; it only wants to see the keys.
    """
    distro = os.environ.get("ROS_DISTRO", "jazzy")
    told = {
        "version": 8,
        "storage_identifier": "mcap",
        "duration": {"nanoseconds": 0},
        "starting_time": {"nanoseconds_since_epoch": start_time},
        "message_count": 0,
        "topics_with_message_count": [],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [],
        "files": [],
        "custom_data": {},
        "ros_distro": distro,
    }
    return {"ROS_DISTRO": distro, "serialized_metadata": yaml.safe_dump(told, sort_keys=False)}


def offered_qos_profiles(topic: Topic) -> str:
    """Return a topic's quality of service as rosbag2 keeps it with a topic (YAML)."""
    return (
        f"- history: 1\n  depth: {topic.depth}\n  reliability: 1\n"
        f"  durability: {1 if topic.qos.transient_local else 2}\n"
        f"  deadline: {_FOREVER}\n  lifespan: {_FOREVER}\n  liveliness: 1\n"
        f"  liveliness_lease_duration: {_FOREVER}\n  avoid_ros_namespace_conventions: false\n"
    )


def _sync_folder(folder: Path) -> None:
    # The new file's name shall survive a power cut as well as its content; not every system can.
    try:
        descriptor = os.open(folder, os.O_RDONLY)
    except OSError:
        return
    try:
        os.fsync(descriptor)
    except OSError:
        pass
    finally:
        os.close(descriptor)
