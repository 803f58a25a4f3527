"""``InterferometerSamples`` to blocks of samples and back, without an object for each sample."""

from array import array
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepdiag_ros.messages.fields import set_header, to_nanoseconds
from stepdiag_ros.messages.types import NewMessage, new_message
from stepdiag_ros.metrology.measurement import Environment
from stepdiag_ros.metrology.samples import SampleBlock
from stepdiag_ros.topics import SAMPLES


def to_sample_block(message: Any) -> SampleBlock:
    """Convert an ``InterferometerSamples``.

    Raises:
        ValueError: it holds no samples, or another number of signals or states.
    """
    return SampleBlock(
        time=to_nanoseconds(message.header.stamp),
        sequence=int(message.sequence),
        period=float(message.period),
        zero=int(message.zero),
        scale=float(message.compensation_scale),
        offset=float(message.compensation_offset),
        environment=Environment(*(float(getattr(message, name)) for name in Environment._fields)),
        raw_displacement=np.array(message.raw_displacement, dtype=np.float64),
        signal_strength=np.array(message.signal_strength, dtype=np.float32),
        status=np.array(message.status, dtype=np.uint8),
    )


def from_sample_block(
    block: SampleBlock, frame: str, decimation: int, new: NewMessage = new_message
) -> Any:
    """Make an ``InterferometerSamples``.

    Args:
        block: the samples.
        frame: of the instrument, for the header.
        decimation: samples from one reading that is made of them to the next; 0 if none are.
        new: makes the empty message.
    """
    message = new(SAMPLES.type_name)
    set_header(message, block.time, frame)
    message.sequence = int(block.sequence)
    message.period = float(block.period)
    message.zero = int(block.zero)
    message.decimation = int(decimation)
    message.compensation_scale = float(block.scale)
    message.compensation_offset = float(block.offset)
    for name, value in block.environment._asdict().items():
        setattr(message, name, float(value))
    message.raw_displacement = _packed("d", block.raw_displacement.astype(np.float64))
    message.signal_strength = _packed("f", block.signal_strength.astype(np.float32))
    message.status = _packed("B", block.status.astype(np.uint8))
    return message


def _packed(code: str, values: NDArray[Any]) -> "array[Any]":
    # The one form that rclpy's setters, the embedded client and a bag accept for a sequence.
    packed = array(code)
    packed.frombytes(values.tobytes())
    return packed
