"""Which readings of a run are wrong, found one after another (see ``wrong_reading``)."""

from typing import NamedTuple

from stepdiag_ros.metrology.discrepancy.start import Model, Progress, Start
from stepdiag_ros.metrology.discrepancy.wrong_reading import (
    FEW_SLIPS,
    QUIETER,
    WrongReading,
    are_slips,
    many_slips,
    most_wrong,
)


class Slips(NamedTuple):
    """Readings that stand out, and the run without them.

    Attributes:
        found: none, if they are too many or in a row.
        rest: the run without them.
        first: they are looked at before effects.
    """

    found: list[WrongReading]
    rest: Start
    first: bool


def find_slips(start: Start, model: Model, tell: Progress) -> tuple[Slips, Slips]:
    """Return the readings of a run that stand out from the rest, and those that are surely wrong.

    They are taken off one after another.
    """
    taken: list[WrongReading] = []
    slips = sure = Slips([], start, False)
    now, most = start, many_slips(start.stops)
    while now.noise_is_known:
        rotation = now.measurement.plausible.rotation
        wrong = most_wrong(now.baseline, now.stops, now.noise, rotation)
        if wrong is None:
            break
        taken.append(wrong)
        if not are_slips(taken, most):
            # Beyond a few clear ones, what hides may be an effect; else too much is wrong.
            few = slips.first and all(one.clear for one in slips.found)
            return (slips if few and not wrong.clear else Slips([], start, False)), sure
        tell("leaving out a reading that stands out")
        now = model.start(wrong.without(now.measurement))
        if wrong.clear:
            few = len(taken) <= FEW_SLIPS and all(one.clear for one in taken)
            quieter = QUIETER * now.noise.size < start.noise.size
            slips = Slips(list(taken), now, few or quieter)
            if all(one.sure for one in taken):
                sure = slips
    return slips, sure
