"""From the samples of a fast interferometer to readings: a low-pass filter, and every n-th value.

The filter is a finite impulse response with symmetric coefficients (linear phase): a reading
stands at the time of its middle sample, and no delay is left in the stamps. It is a sinc in the
window of Kaiser (Proc. IEEE Int. Symp. Circuits and Systems 1974, 20; for 100 dB), corrected so
that the coefficients at each remainder of the sample's number modulo the factor have the same sum,
1/factor. With f the rate of the readings:

- 0 to 0.25 f: passes within 0.001 dB; half at 0.5 f.
- from 0.75 f on: at least 90 dB down. What is left in the readings below 0.25 f has not been folded
  there from any higher frequency; f, 2f, 3f … do not pass at all.
- All samples count alike in the mean of many readings: only those at the two ends of the window
  weigh differently. With M readings, and r the largest distance of any sample that they are made of
  from the mean of the samples, the mean of the readings is within r/M of that of the samples.

A reading depends on the samples in front of and behind it, to ``Decimator.half`` either way, and
on nothing else, least of all on how they were cut into blocks: a replay is bit-identical.
"""

from collections import deque
from functools import lru_cache
from math import ceil, nan

import numpy as np
from numpy.typing import NDArray

from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.measurement import Reading
from stepdiag_ros.metrology.samples import Bytes, SampleBlock, Singles

HALF_LENGTH = 6.5
"""Half the filter's length in periods of the readings."""
_ATTENUATION = 100.0
"""dB that the window is designed for."""
ZERO_LOST = 2
"""STATUS_BEAM_LOST of InterferometerReading.msg: of a reading with a new zero in its middle."""


def decimation_factor(sample_rate: float, highest_rate: float) -> int:
    """Return the smallest number of samples to a reading with which readings are not too many.

    Args:
        sample_rate: Hz.
        highest_rate: of the readings, Hz.
    """
    # A rate that is a whole multiple must not be rounded up by the last digit of the quotient.
    return max(1, ceil(sample_rate / highest_rate - 1e-9))


@lru_cache(maxsize=8)
def coefficients(factor: int) -> Vector:
    """Return the coefficients of the filter, shape (2·half + 1,); the module says what it does."""
    if factor == 1:
        return np.ones(1)
    half = round(HALF_LENGTH * factor)
    number: NDArray[np.int64] = np.arange(-half, half + 1)
    window = np.kaiser(len(number), 0.1102 * (_ATTENUATION - 8.7))
    values = np.sinc(number / factor) * window
    for remainder in range(factor):
        alike = number % factor == remainder
        values[alike] /= factor * float(np.sum(values[alike]))
    symmetric: Vector = 0.5 * (values + values[::-1])
    symmetric.setflags(write=False)
    return symmetric


class Decimator:
    """Makes readings of blocks of samples as they come.

    Reading k stands at sample k · factor. It is good if all samples that it is made of are: its
    status is the worst of them, its signal the weakest. One that would be made of samples with
    different zeros is not a displacement (NaN) and has lost its zero. One for which a sample is
    missing is not made, so that its number is missing too. The compensation is that of the middle
    sample.

    Args:
        factor: samples from one reading to the next.

    Attributes:
        factor: the same.
        half: how many samples before and behind its own a reading is made of.
    """

    def __init__(self, factor: int) -> None:
        self.factor = factor
        self._filter = coefficients(factor)
        self.half = len(self._filter) // 2
        # Samples in a row that are still needed, and the number of the first.
        self._first = 0
        self._raw: Vector = np.empty(0)
        self._signal: Singles = np.empty(0, dtype=np.float32)
        self._status: Bytes = np.empty(0, dtype=np.uint8)
        self._blocks: deque[SampleBlock] = deque()
        # Numbers of samples that have another zero than the one before them.
        self._new_zeros: deque[int] = deque()
        # The zero is another one since a gap, and no reading has reported it yet.
        self._lost_in_gap = False

    def add(self, block: SampleBlock) -> list[Reading]:
        """Take the next block; return the readings for which all samples are there now, in order.

        A block that does not follow the one before without a gap, or an instrument that has begun
        to count again, begins the filter again.
        """
        last = self._blocks[-1] if self._blocks else None
        if last is None or block.sequence != last.end:
            self._lost_in_gap |= last is not None and block.zero != last.zero
            self._begin_at(block.sequence)
        elif block.zero != last.zero:
            self._new_zeros.append(block.sequence)
        count = len(block)
        self._raw = np.concatenate((self._raw, block.raw_displacement))
        self._signal = np.concatenate((self._signal, _of_each(block.signal_strength, count)))
        self._status = np.concatenate((self._status, _of_each(block.status, count)))
        self._blocks.append(block)
        first = -(-(self._first + self.half) // self.factor)
        last_number = (block.end - 1 - self.half) // self.factor
        readings = [self._reading(number) for number in range(first, last_number + 1)]
        if readings and self._lost_in_gap:
            self._lost_in_gap = False
            readings[0] = readings[0]._replace(
                raw_displacement=nan,
                compensated_displacement=nan,
                status=max(readings[0].status, ZERO_LOST),
            )
        if readings:
            self._forget((last_number + 1) * self.factor - self.half)
        return readings

    def _begin_at(self, sequence: int) -> None:
        self._first = sequence
        self._raw, self._signal, self._status = self._raw[:0], self._signal[:0], self._status[:0]
        self._blocks.clear()
        self._new_zeros.clear()

    def _reading(self, number: int) -> Reading:
        middle = number * self.factor
        begin = middle - self.half - self._first
        span = slice(begin, begin + len(self._filter))
        while self._blocks[0].end <= middle:
            self._blocks.popleft()
        block = self._blocks[0]
        status = int(np.max(self._status[span]))
        samples = self._raw[span]
        if any(begin < zero - self._first < begin + len(samples) for zero in self._new_zeros):
            raw, status = nan, max(status, ZERO_LOST)
        else:
            # About the middle sample: a metre of displacement then costs no digits of a nanometre.
            raw = float(samples[self.half])
            raw += float(np.sum((samples - raw) * self._filter))
        return Reading(
            time=block.time_of(middle),
            sequence=number,
            raw_displacement=raw,
            compensated_displacement=block.scale * raw + block.offset,
            signal_strength=float(np.min(self._signal[span])),
            status=status,
            environment=block.environment,
        )

    def _forget(self, until: int) -> None:
        """Drop the samples before a number; no later reading needs them."""
        spent = until - self._first
        self._raw, self._signal = self._raw[spent:], self._signal[spent:]
        self._status = self._status[spent:]
        self._first = until
        while self._new_zeros and self._new_zeros[0] <= until:
            self._new_zeros.popleft()


def _of_each(values: NDArray[np.generic], count: int) -> NDArray[np.generic]:
    return values if len(values) == count else np.repeat(values, count)
