"""Where readings come from: an instrument that gives them, or samples that they are made of."""

from dataclasses import replace
from math import nan

from stepdiag_ros.devices.interferometer import InterferometerDevice, StreamsSamples
from stepdiag_ros.metrology.air.compensator import Compensator
from stepdiag_ros.metrology.decimation import Decimator, decimation_factor
from stepdiag_ros.metrology.measurement import Environment, Reading
from stepdiag_ros.metrology.samples import SampleBlock

_UNKNOWN = Environment()
BLOCK_PERIOD = 0.01
"""s of a clock that never steps between two looks at an instrument that gives samples."""


class ReadingSource:
    """Takes readings from an instrument as often as is good for it.

    Args:
        device: the instrument.
        highest_rate: Hz; of one that gives samples faster, readings are made of these.
        late: s by which the instrument's time stamps are known to be late; taken off them.
        compensator: compensates readings and samples for the air; None: they stay as they are.

    Attributes:
        factor: samples from one reading to the next; 0 if the instrument gives readings.
        rate: of the readings, Hz; NaN if the instrument gives them, and it alone knows.
        mixing: ns before and behind a new zero within which a reading is made of samples with both.
    """

    def __init__(
        self,
        device: InterferometerDevice,
        highest_rate: float,
        late: float,
        compensator: Compensator | None = None,
    ) -> None:
        self._device = device
        self._compensator = compensator
        self._late = round(late * 1e9)
        self._stream: StreamsSamples | None = None
        self._next_look = 0.0
        self.factor, self.rate, self.mixing = 0, nan, 0
        if isinstance(device, StreamsSamples) and device.sample_rate > highest_rate:
            self._stream = device
            self.factor = decimation_factor(device.sample_rate, highest_rate)
            self.rate = device.sample_rate / self.factor
            self._decimator = Decimator(self.factor)
            self.mixing = round(self._decimator.half / device.sample_rate * 1e9)

    def poll(
        self, now: int, real: float, air: Environment = _UNKNOWN
    ) -> tuple[list[SampleBlock], list[Reading]]:
        """Return the samples, if there are any, and the readings since the last look, in order.

        Args:
            now: ROS time, ns.
            real: s of a clock that never steps.
            air: by the weather sensors.
        """
        if self._stream is None:
            return [], [self._finished(reading, air) for reading in self._device.poll(now)]
        if real < self._next_look:
            return [], []
        self._next_look = real + BLOCK_PERIOD
        blocks = self._stream.poll_samples(now)
        if self._late:
            blocks = [replace(block, time=block.time - self._late) for block in blocks]
        if self._compensator is not None:
            blocks = [self._compensator.block(block, air) for block in blocks]
        return blocks, [reading for block in blocks for reading in self._decimator.add(block)]

    def _finished(self, reading: Reading, air: Environment) -> Reading:
        if self._late:
            reading = reading._replace(time=reading.time - self._late)
        return reading if self._compensator is None else self._compensator.reading(reading, air)
