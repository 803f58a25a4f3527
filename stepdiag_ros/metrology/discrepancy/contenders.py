"""Who else may be the cause of a gap: a finding, what the run cannot rule out, and what lost by it.

A candidate that lost by odds of 1 to 50 need not be named beside the winner, but readings that are
still to be taken may bring it near again. An extra plan has to allow for it.
"""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from stepdiag_ros.metrology.discrepancy.baseline import fit_baseline, whitened
from stepdiag_ros.metrology.discrepancy.candidates import signatures
from stepdiag_ros.metrology.discrepancy.chance import LookElsewhere
from stepdiag_ros.metrology.discrepancy.fading import fading
from stepdiag_ros.metrology.discrepancy.findings import Candidate, Diagnosis, Finding
from stepdiag_ros.metrology.discrepancy.formula_rivals import FormulaRivals, Question
from stepdiag_ros.metrology.discrepancy.loose import loosened
from stepdiag_ros.metrology.discrepancy.ranking import Ranker
from stepdiag_ros.metrology.discrepancy.rivals import Rival
from stepdiag_ros.metrology.effects.effect import ActiveEffect, Effect
from stepdiag_ros.metrology.measurement import Measurement

_BEHIND = 9.0
"""Evidence behind the finding up to which a name is considered: odds of 1 to 8000."""
_UNLIKELY = 1e-4
"""Probability of a rival that only looks alike and is far behind by the evidence."""


class Contenders:
    """The candidates of a run, judged once more beside the findings.

    Args:
        measurement: the runs so far.
        diagnosis: of them.
        known: as given to ``diagnose``, like the following.
        catalogue: effects that were tried.
        fitted: effects of the model whose sizes are free.
        curves: that the model has fixed.
    """

    def __init__(
        self,
        measurement: Measurement,
        diagnosis: Diagnosis,
        known: Sequence[ActiveEffect],
        catalogue: Iterable[Effect],
        fitted: Sequence[ActiveEffect],
        curves: Mapping[str, Sequence[float]],
    ) -> None:
        stops = diagnosis.stops
        baseline = fit_baseline(measurement, stops, known, fitted, curves)
        baseline = loosened(baseline, stops, diagnosis.loose)
        self._problem = problem = whitened(baseline, diagnosis.noise, diagnosis.noise_correlation)
        self._stops = stops
        taken = {(one.effect.name, one.effect.label(one.setting)) for one in fitted}
        self._found = signatures(catalogue, stops, problem, taken)
        self._findings = diagnosis.findings
        self._place = {one.label: place for place, one in enumerate(self._found.candidates)}
        luck = LookElsewhere(1.0, diagnosis.noise_degrees_of_freedom)
        self._ranker = Ranker(self._found, problem.gap, luck)
        self._formulas = FormulaRivals(diagnosis, problem)

    def questions(self) -> list[Question]:
        """Return what is open: of each finding with rivals, and of each formula with rivals."""
        made = [
            Question(self.rivals(finding), self._beside(finding))
            for finding in self._findings
            if finding.ambiguous
        ]
        return [*made, *self._formulas.questions()]

    def _beside(self, finding: Finding) -> list[Candidate]:
        return [one.candidate for one in self._findings if one is not finding]

    def rivals(self, finding: Finding) -> list[Rival]:
        """Return a finding and what else may be the cause, one of each name, the finding first.

        Rotations of all axes at once are not a candidate and take no part: they are free in the
            model.
        """
        if finding.label not in self._place:
            return []
        own = self._place[finding.label]
        others = (one.label for one in self._findings if one is not finding)
        beside = [self._place[label] for label in others if label in self._place]
        evidence = self._ranker.ranking(beside).evidence
        chances = {one.label: one.probability for one in finding.runners_up}
        best: dict[str, int] = {}
        for place in np.argsort(-evidence):
            if np.isfinite(evidence[place]):
                best.setdefault(self._found.names[place], int(place))
        made = {self._found.names[own]: Rival(finding.candidate, finding.probability)}
        for label in dict.fromkeys((*finding.ambiguous, *chances)):
            if label not in self._place:
                continue
            place = self._place[label]
            rival = Rival(self._found.candidates[place], max(chances.get(label, 0.0), _UNLIKELY))
            made.setdefault(self._found.names[place], rival)
        top = evidence[best[self._found.names[own]]]
        for name, place in best.items():
            candidate = self._found.candidates[place]
            if evidence[place] > top - _BEHIND and not candidate.is_bound:
                chance = finding.probability * float(np.exp(min(evidence[place] - top, 0.0)))
                made.setdefault(name, Rival(candidate, max(chance, _UNLIKELY)))
        fades = fading(finding.candidate, self._beside(finding), self._problem, self._stops)
        if fades is not None and fades.odds > np.exp(-_BEHIND):
            chance = max(finding.probability * min(fades.odds, 1.0), _UNLIKELY)
            made[fades.candidate.label] = Rival(fades.candidate, chance)
        return [*made.values(), *self._formulas.of_the_name(finding)]
