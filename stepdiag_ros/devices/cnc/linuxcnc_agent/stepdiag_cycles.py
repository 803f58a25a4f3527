"""Positions of every servo cycle of LinuxCNC, by HAL's ``sampler``, and the time of each cycle.

Beside ``stepdiag_agent.py``, for the same Python (see there). What a program reads from HAL belongs
to some moment of the last servo cycle, and to another one for each pin. The sampler records all
pins within the cycle, in real time, and numbers what it records; a line on the fly needs that.
"""

from __future__ import annotations

import contextlib
import subprocess
import time
from collections import deque
from collections.abc import Sequence

import hal

Sample = tuple[int, tuple[float, ...]]
"""Time, ns of the computer's clock, and the values of all pins, in their own units."""

DEPTH = 8192
"""Cycles that wait for this program at most: 8 s of a servo thread of 1 kHz."""
THREAD = "servo-thread"
_BLOCK = 1_000_000_000
_BLOCKS = 10


class CycleClock:
    """Which time each numbered cycle has, from when its number was seen.

    Cycles are equally far apart, and none is seen before it is there: the earliest sight of the
    last seconds says when they are. A clock that is set back acts at once, one that is set forward
    after these seconds.

    Args:
        period: of the cycles, ns.
    """

    def __init__(self, period: int) -> None:
        self.period = period
        # Begin of a block of time and its earliest zero, ns.
        self._zeros: deque[list[int]] = deque(maxlen=_BLOCKS)

    def see(self, number: int, now: int) -> None:
        """Take note that a cycle was there at a time, ns."""
        zero = now - number * self.period
        if self._zeros and 0 <= now - self._zeros[-1][0] < _BLOCK:
            self._zeros[-1][1] = min(self._zeros[-1][1], zero)
        else:
            self._zeros.append([now, zero])

    def time(self, number: int) -> int:
        """Return the time of a cycle, ns."""
        return min(zero for _, zero in self._zeros) + number * self.period


class Cycles:
    """Reads what the sampler has recorded of some pins.

    Args:
        component: HAL component of this program.
        pins: to record, all of type float.

    Attributes:
        clock: the times of cycles.
        latest: time of the last cycle that was read, ns; 0 before the first.

    Raises:
        OSError: HAL has no sampler for this program; the text says why.
    """

    def __init__(self, component: hal.component, pins: Sequence[str]) -> None:
        if hal.component_exists("sampler"):
            raise OSError("another program uses HAL's sampler")
        self.clock = CycleClock(_period())
        self.latest = 0
        kinds = "f" * len(pins)
        _halcmd("loadrt", "sampler", f"depth={DEPTH}", f"cfg={kinds}")
        try:
            for number, pin in enumerate(pins):
                signal = _signal(pin) or f"stepdiag-sampled-{number}"
                _halcmd("net", signal, pin, f"sampler.0.pin.{number}")
            _halcmd("addf", "sampler.0", THREAD)
            self._stream = hal.stream(component, hal.sampler_base, kinds)
        except (OSError, RuntimeError) as error:
            self.close()
            raise OSError(str(error)) from error

    def read(self, after: int) -> list[Sample]:
        """Return the cycles since the last call, in order; their times rise.

        Args:
            after: time, ns, that all of them are later than: the status of a machine whose cycles
                stalled was given a time by the clock, and cycles go on after that.
        """
        found = []
        while (values := self._stream.read()) is not None:
            found.append((int(self._stream.sampleno), values))
        if found:
            self.clock.see(found[-1][0], time.time_ns())
        samples: list[Sample] = []
        for number, values in found:
            self.latest = max(self.clock.time(number), max(self.latest, after) + 1)
            samples.append((self.latest, values))
        return samples

    def close(self) -> None:
        """Give the sampler back."""
        for words in (("delf", "sampler.0", THREAD), ("unloadrt", "sampler")):
            with contextlib.suppress(OSError):
                _halcmd(*words)


def _halcmd(*words: str) -> str:
    done = subprocess.run(["halcmd", "-s", *words], capture_output=True, text=True, check=False)
    if done.returncode:
        raise OSError(f"halcmd {' '.join(words)}: {' '.join((done.stderr or done.stdout).split())}")
    return done.stdout


def _period() -> int:
    """Return the period of the servo thread, ns."""
    for line in _halcmd("show", "thread").splitlines():
        words = line.split()
        if THREAD in words:
            return int(words[0])
    raise OSError(f"HAL has no thread {THREAD}")


def _signal(pin: str) -> str:
    """Return the signal that a pin is linked with; empty if it is free.

    Raises:
        OSError: there is no such pin.
    """
    for line in _halcmd("show", "pin", pin).splitlines():
        words = line.split()
        if pin in words:
            after = words[words.index(pin) + 1 :]
            return after[1] if len(after) > 1 else ""
    raise OSError(f"HAL has no pin {pin}")
