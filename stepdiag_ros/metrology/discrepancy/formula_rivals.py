"""Formulas as rivals: of a name, and of one another.

The displacement that one formula describes along X may be one along Y for all that a run shows, and
what a name explains a formula may explain as well. Further lines can decide that, but for what
depends on the time of the run: it does not come again with the same phase.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stepdiag_ros.metrology.discrepancy.baseline import Whitened
from stepdiag_ros.metrology.discrepancy.describe import Describer
from stepdiag_ros.metrology.discrepancy.described import WITHOUT_A_NAME
from stepdiag_ros.metrology.discrepancy.findings import (
    DESCRIBED,
    Candidate,
    Dependence,
    Diagnosis,
    Finding,
    dependence_words,
)
from stepdiag_ros.metrology.discrepancy.loose import unit_span
from stepdiag_ros.metrology.discrepancy.rivals import Rival
from stepdiag_ros.metrology.effects.learned_rotation import learned
from stepdiag_ros.metrology.effects.learned_shape import driver, factors
from stepdiag_ros.metrology.geometry import Vector

_OF_THE_RUN = ("time", "the line")
"""Beginnings of what a further run does not repeat: its time, and the air on one of its lines."""


@dataclass(frozen=True)
class Question:
    """Rivals of which one is the cause.

    Attributes:
        rivals: the likeliest first, as far as the diagnosis says.
        beside: what acts beside it.
    """

    rivals: list[Rival]
    beside: list[Candidate]


class FormulaRivals:
    """Writes formulas that a diagnosis does not rule out.

    Args:
        diagnosis: of the runs so far.
        problem: whitened as in the diagnosis, the baseline projected out.
    """

    def __init__(self, diagnosis: Diagnosis, problem: Whitened) -> None:
        self._diagnosis = diagnosis
        self._problem = problem

    @cached_property
    def _describer(self) -> Describer:
        # Only where a formula is a rival: most extra plans are for effects alone.
        freedom = self._diagnosis.noise_degrees_of_freedom
        return Describer(self._problem, self._diagnosis.stops, freedom, 0)

    def of_the_name(self, finding: Finding) -> Iterator[Rival]:
        """Yield the formula of the whole gap, if it is a rival of the only name."""
        rivals = [one for one in finding.runners_up if one.label.startswith(WITHOUT_A_NAME)]
        if not rivals or len(self._diagnosis.findings) > 1:
            return
        shapes = self._describer(self._span(()))
        if shapes is None:
            return
        (rival,) = rivals
        acting = [one for part in shapes.dependences for one in _acting(part.acts_on, part.shapes)]
        if _comes_again(acting):
            yield Rival(acting[0], rival.probability, tuple(acting[1:]), rival.label)

    def questions(self) -> Iterator[Question]:
        """Yield each dependence of a description that others rival."""
        description = self._diagnosis.description
        if self._diagnosis.verdict != DESCRIBED or description is None:
            return
        for one in description.dependences:
            if one.rivals:
                yield self._question(one)

    def _question(self, one: Dependence) -> Question:
        own = _acting(one.acts_on, one.shapes)
        labels = {candidate.label for candidate in own}
        findings = [finding.candidate for finding in self._diagnosis.findings]
        beside = [candidate for candidate in findings if candidate.label not in labels]
        wanted = [(one.acts_on, one.drivers), *one.rivals]
        written = self._describer.written(self._span(beside), wanted)
        best = written[0][1]
        rivals = [Rival(own[0], one.probability, tuple(own[1:]), one.words)]
        for (acts_on, drivers), (shapes, evidence) in zip(wanted[1:], written[1:], strict=True):
            acting = _acting(acts_on, shapes)
            chance = one.probability * float(np.exp(min(evidence - best, 0.0)))
            if acting:
                words = dependence_words(acts_on, drivers)
                rivals.append(Rival(acting[0], chance, tuple(acting[1:]), words))
        return Question([rival for rival in rivals if _comes_again(rival.acting)], beside)

    def _span(self, beside: Sequence[Candidate]) -> Vector:
        columns = [self._problem.left_of(one.free(self._diagnosis.stops)) for one in beside]
        return unit_span(np.column_stack([np.zeros((len(self._problem.gap), 0)), *columns]))


def _acting(acts_on: str, shapes: Iterable[str]) -> list[Candidate]:
    effect = learned(acts_on)
    settings = [{"acts_on": acts_on, "shape": shape} for shape in shapes]
    return [Candidate(effect, setting, effect.label(setting)) for setting in settings]


def _comes_again(acting: Iterable[Candidate]) -> bool:
    words = [driver(text) for one in acting for text in factors(str(one.setting["shape"]))]
    return not any(one.startswith(_OF_THE_RUN) for one in words)
