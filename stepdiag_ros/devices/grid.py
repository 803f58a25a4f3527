"""The instants at which a device samples: an exact grid of whole nanoseconds."""

import numpy as np
from numpy.typing import NDArray


class SampleGrid:
    """Instants start, start + 1/rate, start + 2/rate …, each rounded on its own, so none drifts.

    Args:
        start: first instant, ns.
        rate: Hz, > 0.

    Attributes:
        count: how many instants have been taken.
    """

    def __init__(self, start: int, rate: float) -> None:
        self._start = start
        self._rate = rate
        self.count = 0

    @property
    def next(self) -> int:
        """Return the next instant, ns."""
        return self._instant(self.count)

    def take(self, until: int) -> list[int]:
        """Return and use up the instants up to a time (included), ns."""
        taken: list[int] = []
        while (instant := self._instant(self.count)) <= until:
            taken.append(instant)
            self.count += 1
        return taken

    def take_array(self, until: int, most: int) -> NDArray[np.int64]:
        """Return and use up the instants up to a time (included), ns, but not more than so many."""
        end = self._number(until + 1)
        numbers = np.arange(self.count, max(self.count, min(end, self.count + most)))
        self.count += len(numbers)
        instants: NDArray[np.int64] = np.rint(numbers * 1e9 / self._rate).astype(np.int64)
        instants += self._start
        return instants

    def first(self, time: int) -> int:
        """Return the first instant at or after a time, ns, taken or not."""
        return self._instant(self._number(time))

    def within(self, begin: int, end: int) -> list[int]:
        """Return the instants from one time until before another, ns, taken or not."""
        numbers = range(self._number(begin), self._number(end))
        return [self._instant(number) for number in numbers]

    def _number(self, time: int) -> int:
        """Return the number of the first instant at or after a time (ns)."""
        number = max(int((time - self._start) * 1e-9 * self._rate) - 1, 0)
        while self._instant(number) < time:
            number += 1
        return number

    def _instant(self, number: int) -> int:
        return self._start + round(number * 1e9 / self._rate)
