"""What every bag offers for reading, whether it is one file or a folder of several."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator, Mapping
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, NamedTuple, TypeVar

from stepdiag_ros.bags.errors import BagError
from stepdiag_ros.bags.header import METADATA_NAME, Attachment, RunHeader
from stepdiag_ros.bags.tally import Flaw
from stepdiag_ros.bags.types import MessageTypes, types_from_schemas
from stepdiag_ros.metrology.refusal import fields_of
from stepdiag_ros.topics import topic_of

Order = Literal["file", "time"]
_Self = TypeVar("_Self", bound="Bag")
_Made = TypeVar("_Made")


class RecordedMessage(NamedTuple):
    """One recorded message.

    Attributes:
        topic: full name.
        type_name: for example ``stepdiag_ros/msg/RunState``.
        log_time: when it was received, ns.
        publish_time: when it was sent, ns.
        sequence: of the publisher; 0 if not known.
        data: serialised message (CDR with its encapsulation).
    """

    topic: str
    type_name: str
    log_time: int
    publish_time: int
    sequence: int
    data: bytes


class Payloads(NamedTuple):
    """Messages of one topic that follow each other, as parallel lists.

    Attributes:
        type_name: of all of them.
        times: when each was received, ns.
        data: the serialised messages.
    """

    type_name: str
    times: list[int]
    data: list[bytes]


class Bag(ABC):
    """A complete bag, opened for reading; a context manager closes it.

    Attributes:
        path: of the file or the folder.
        metadata: name → texts of the metadata records.
        attachments: files inside the bag.
    """

    path: Path
    metadata: dict[str, Mapping[str, str]]
    attachments: list[Attachment]

    def __enter__(self: _Self) -> _Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    @abstractmethod
    def close(self) -> None:
        """Close the bag; harmless when called again."""

    @property
    @abstractmethod
    def size(self) -> int:
        """Return the size in bytes."""

    @property
    @abstractmethod
    def has_data_checksum(self) -> bool:
        """Say whether a checksum covers all that stands before the summary (``ros2 bag``: none)."""

    @property
    @abstractmethod
    def chunk_count(self) -> int:
        """Return the number of chunks."""

    @property
    @abstractmethod
    def topics(self) -> dict[str, str]:
        """Return the full names of the topics and their types, in the order of first recording."""

    @property
    @abstractmethod
    def start_time(self) -> int:
        """Return the first log time, ns; 0 without messages."""

    @property
    @abstractmethod
    def end_time(self) -> int:
        """Return the last log time, ns; 0 without messages."""

    @abstractmethod
    def flaws(self) -> tuple[Flaw, ...]:
        """Return what is missing, doubled or out of order by the counts of the recording.

        Raises:
            BagCorruptError: a chunk's checksum is wrong; the text names the offset.
        """

    @abstractmethod
    def definitions(self) -> dict[str, str]:
        """Return type → text of its definition, of all recorded topics that have it as ``ros2msg``.

        Raises:
            BagError: two files of the bag define a type differently.
        """

    @abstractmethod
    def records(
        self,
        order: Order = "file",
        topics: Collection[str] | None = None,
        start: int | None = None,
        end: int | None = None,
    ) -> Iterator[RecordedMessage]:
        """Go through the recorded messages, each once; see ``flaws``.

        Args:
            order: ``file``: as they were written, or by log time where the numbers of the
                messages show another order than the one they were written in; ``time``: by log
                time, equal times as written.
            topics: full names of the wanted topics; all if None.
            start: first log time, ns.
            end: last log time, ns.

        Raises:
            BagCorruptError: a chunk's checksum is wrong; the text names the offset.
        """

    def payloads(self, topic: str) -> Iterator[Payloads]:
        """Go through the messages of one topic in the order of ``records``, some at a time.

        Raises:
            BagCorruptError: a chunk's checksum is wrong; the text names the offset.
        """
        for record in self.records(topics=(topic,)):
            yield Payloads(record.type_name, [record.log_time], [record.data])

    @cached_property
    def header(self) -> RunHeader:
        """Return the identity of the run and the texts that it was made from.

        Raises:
            BagError: the bag was not made by this software.
        """
        if METADATA_NAME not in self.metadata:
            raise BagError(
                f"{self.path} was not recorded by stepdiag_ros: it has no identity of a run in"
                " front of its messages"
            )
        try:
            return RunHeader.from_parts(self.metadata[METADATA_NAME], self.attachments)
        except ValueError as error:
            raise BagError(
                f"{self.path}: the identity of the run cannot be read: {error}"
            ) from None

    @cached_property
    def types(self) -> MessageTypes:
        """Return the message definitions that the bag carries.

        Raises:
            BagError: a definition cannot be used, or two files define a type differently.
        """
        definitions = self.definitions()
        try:
            return types_from_schemas(definitions)
        except BagError as error:
            raise BagError(f"{self.path}: {error}", **fields_of(error)) from None

    def decode(self, record: RecordedMessage) -> Any:
        """Return a recorded message as an object with the message's attributes.

        Raises:
            BagError: it cannot be decoded; the text names topic and time.
        """
        due = self._types_due.get(record.topic, record.type_name)
        if record.type_name != due:
            raise BagError(
                f"{self.path}: messages on {record.topic} are of type {record.type_name} instead of"
                f" {due}",
                fault="mismatch",
            )
        if record.type_name not in self.types:
            raise BagError(
                f"{self.path}: messages on {record.topic} cannot be decoded: the bag does not have"
                f" the definition of {record.type_name} as ros2msg text",
                fault="undetermined",
            )
        try:
            return self.types.decode(record.type_name, record.data)
        except BagError as error:
            raise BagError(
                f"{self.path}: the message on {record.topic} at {record.log_time} ns "
                f"cannot be decoded: {error}",
                **fields_of(error),
            ) from None

    @cached_property
    def _types_due(self) -> dict[str, str]:
        """Return the types that the suite's topics have, by their full names in this bag."""
        known = {name: topic_of(name) for name in self.topics}
        return {name: found[0].type_name for name, found in known.items() if found is not None}

    def converted(
        self, record: RecordedMessage, convert: Callable[[Any], _Made], message: Any = None
    ) -> _Made:
        """Decode a recorded message and make a data class of it.

        Args:
            record: the message.
            convert: makes the data class; raises ``ValueError`` where the message contradicts
                itself.
            message: decoded already; None if not.

        Raises:
            BagError: it cannot be decoded or converted; the text names topic and time.
        """
        try:
            return convert(self.decode(record) if message is None else message)
        except BagError:
            raise
        except (ValueError, OverflowError) as error:
            raise BagError(
                f"{self.path}: {record.topic} at {record.log_time} ns: {error}",
                **fields_of(error),
            ) from None

    def messages(
        self, order: Order = "file", topics: Collection[str] | None = None
    ) -> Iterator[tuple[RecordedMessage, Any]]:
        """Go through the recorded messages and decode each; see ``records`` and ``decode``."""
        for record in self.records(order, topics):
            yield record, self.decode(record)
