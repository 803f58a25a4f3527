"""Whether anything has changed: every number that stands in a table is looked at, and counted.

A table with thirty values of E_n has one or two beyond ±1 of a machine that has not changed. So
the numbers are put into families (all nodes together, squareness, reversal, …). Of a family with n
members, p = n · (the smallest p of a member), and the families are judged together by Holm's method
(Holm 1979, Scand. J. Stat. 6, 65): with m families, at least one is named where m · (the smallest p
of a family) < ``SIGNIFICANT``. Both steps hold for any dependence between the numbers (Bonferroni's
inequality), and there is much: squareness, positioning, straightness and diagonals are made of the
same curves. The probability that anything is named where nothing has changed is at most
``SIGNIFICANT``.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import nan

import numpy as np

from stepdiag_ros.metrology.agreement.joint import SIGNIFICANT, significant_of_many
from stepdiag_ros.metrology.agreement.values import FigureChange

TOGETHER, CURVES, NODES = "all nodes together", "single curves", "single nodes"
OF_CURVES = (TOGETHER, CURVES, NODES)
"""The three families that look at the error curves themselves."""


@dataclass(frozen=True)
class Family:
    """Numbers of one kind.

    Attributes:
        name: ``OF_CURVES`` or one of ``values.FAMILIES``.
        probabilities: name of each member that is known → probability that chance alone makes it
            differ as much.
        changed: chance does not explain the family's largest change, although there are many
            members and many families.
    """

    name: str
    probabilities: Mapping[str, float]
    changed: bool = False

    @property
    def probability(self) -> float:
        """Return a bound of the probability that chance makes any member differ as much."""
        return min(1.0, len(self.probabilities) * min(self.probabilities.values()))

    @property
    def named(self) -> tuple[str, ...]:
        """Return the members that changed, the least explained by chance first; none by itself."""
        return significant_of_many(self.probabilities) if self.changed else ()


@dataclass(frozen=True)
class JointJudgement:
    """What all families together say.

    Attributes:
        families: that have a member with a known probability.
    """

    families: tuple[Family, ...] = ()

    @classmethod
    def of(cls, members: Mapping[str, Mapping[str, float]]) -> "JointJudgement":
        """Judge families.

        Args:
            members: name of the family → name of each member → its probability; NaN where unknown.
        """
        known = {
            family: {name: value for name, value in told.items() if np.isfinite(value)}
            for family, told in members.items()
        }
        families = [Family(name, told) for name, told in known.items() if told]
        named = significant_of_many({one.name: one.probability for one in families})
        return cls(
            tuple(Family(one.name, one.probabilities, one.name in named) for one in families)
        )

    @property
    def known(self) -> bool:
        """Say whether there is anything to judge by."""
        return bool(self.families)

    @property
    def probability(self) -> float:
        """Return a bound of the probability that chance makes all this; NaN where not known."""
        if not self.families:
            return nan
        return min(1.0, len(self.families) * min(one.probability for one in self.families))

    @property
    def significant(self) -> bool:
        """Say whether something has changed: chance is not a good explanation of all families."""
        return self.known and self.probability < SIGNIFICANT

    @property
    def numbers(self) -> int:
        """Return how many numbers were looked at."""
        return sum(len(one.probabilities) for one in self.families)

    def family(self, name: str) -> Family | None:
        """Return a family; None where no member of it is known."""
        return next((one for one in self.families if one.name == name), None)

    def named(self, *families: str) -> tuple[str, ...]:
        """Return the members of some families that changed."""
        return tuple(
            member for one in self.families if one.name in families for member in one.named
        )

    def changed(self, *families: str) -> bool:
        """Say whether one of some families changed."""
        return any(one.changed for one in self.families if one.name in families)


def of_figures(figures: tuple[FigureChange, ...]) -> dict[str, dict[str, float]]:
    """Return the families of figures with the probability of each."""
    made: dict[str, dict[str, float]] = {}
    for one in figures:
        made.setdefault(one.family, {})[one.name] = one.probability
    return made
