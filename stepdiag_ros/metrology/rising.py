"""A stream of numbered events, in which a repetition is known and a contradiction is refused."""

from stepdiag_ros.metrology.refusal import Refusal

MOST = 100_000
"""Events of a stream, far more than a run has."""


class Rising:
    """Keeps what was taken under each number.

    Args:
        what: is numbered, in words.
    """

    def __init__(self, what: str) -> None:
        self._what = what
        self._last = -1
        self._taken: dict[int, str] = {}

    def is_new(self, number: int, event: object) -> bool:
        """Say whether an event is the next, or one that was taken before; take it if it is new.

        Raises:
            ValueError: another event was taken under this number or a higher one, or there are
                more than ``MOST``.
        """
        told = repr(event)  # in which what is not a number is like itself
        if number > self._last:
            if len(self._taken) >= MOST:
                raise Refusal(f"more than {MOST} {self._what}s of one run", fault="too_many")
            self._last = number
            self._taken[number] = told
            return True
        if self._taken.get(number) != told:
            known = f"another {self._what} {number}" if number in self._taken else "a later one"
            raise Refusal(
                f"{self._what} {number} comes after {known}: check for another publisher",
                fault="out_of_order",
            )
        return False
