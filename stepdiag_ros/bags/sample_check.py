"""Samples of a fast interferometer in a bag: are all there, do the readings follow from them?"""

from collections import deque
from dataclasses import dataclass, field
from math import isnan
from typing import Any

from stepdiag_ros.messages import conversion
from stepdiag_ros.messages.samples import to_sample_block
from stepdiag_ros.metrology.decimation import Decimator
from stepdiag_ros.metrology.measurement import Reading


@dataclass
class SampleCheck:
    """Follows the samples of a bag, makes readings of them again, and compares those recorded.

    Attributes:
        blocks: that were recorded.
        samples: in them.
        rate: in a second, Hz.
        missing: samples that are not there between two that are.
        made: recorded readings that the samples are there for.
        different: how many of these are not, bit for bit, what the samples say.
    """

    blocks: int = 0
    samples: int = 0
    rate: float = 0.0
    missing: int = 0
    made: int = 0
    different: int = 0
    _next: int | None = None
    _decimator: Decimator | None = None
    # Made and recorded readings that wait for each other, both in order of their numbers.
    _made: deque[Reading] = field(default_factory=deque)
    _recorded: deque[Reading] = field(default_factory=deque)

    def take_samples(self, message: Any) -> None:
        """Take the next ``InterferometerSamples``.

        Raises:
            ValueError: it is malformed.
        """
        block = to_sample_block(message)
        self.blocks += 1
        self.samples += len(block)
        self.rate = 1.0 / block.period
        if self._next is not None and block.sequence > self._next:
            self.missing += block.sequence - self._next
        if self._next is not None and block.sequence < self._next:
            # The instrument was started again; what waits belongs to the time before.
            self._made.clear()
            self._recorded.clear()
        self._next = block.end
        factor = int(message.decimation)
        if not factor:
            return
        if self._decimator is None or self._decimator.factor != factor:
            self._decimator = Decimator(factor)
        self._made.extend(self._decimator.add(block))
        self._compare()

    def take_reading(self, message: Any) -> None:
        """Take the next ``InterferometerReading`` of the same instrument."""
        if self._recorded and int(message.sequence) < self._recorded[-1].sequence:
            self._recorded.clear()
        self._recorded.append(conversion.to_reading(message))
        self._compare()

    def _compare(self) -> None:
        while self._made and self._recorded:
            made, recorded = self._made[0], self._recorded[0]
            if made.sequence <= recorded.sequence:
                self._made.popleft()
            if recorded.sequence <= made.sequence:
                self._recorded.popleft()
            if made.sequence == recorded.sequence:
                self.made += 1
                self.different += not _same(made, recorded)


def _same(one: Reading, other: Reading) -> bool:
    """Say whether all fields are the same; what is not known is the same as what is not known."""
    pairs = zip((*one[:6], *one.environment), (*other[:6], *other.environment), strict=True)
    return all(a == b or (isnan(a) and isnan(b)) for a, b in pairs)
