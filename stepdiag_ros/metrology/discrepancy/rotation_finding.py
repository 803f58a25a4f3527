"""Rotations of all axes at once as a finding, beside or instead of the effects of single causes."""

from dataclasses import replace

import numpy as np

from stepdiag_ros.metrology.discrepancy import findings as verdicts
from stepdiag_ros.metrology.discrepancy.chance import coverage_factor
from stepdiag_ros.metrology.discrepancy.findings import Candidate, Diagnosis, Finding, RunnerUp
from stepdiag_ros.metrology.discrepancy.loose import RotationTest
from stepdiag_ros.metrology.discrepancy.selection import EVIDENCE_RATIO
from stepdiag_ros.metrology.effects.several_angular_errors import EFFECT as SEVERAL_ANGULAR_ERRORS


def rotation_finding(
    rotations: RotationTest, diagnosis: Diagnosis, ahead: float, freedom: float
) -> Finding:
    """Return rotations of all axes as a finding, with the effects that they won against."""
    size, spread = rotations.size, rotations.standard_uncertainty
    factor = coverage_factor(freedom)
    probability = float(1.0 / (1.0 + np.exp(-np.clip(ahead, -50.0, 50.0))))
    rivals = (*diagnosis.findings, *diagnosis.partial)
    close = bool(diagnosis.findings) and (1.0 - probability) * EVIDENCE_RATIO > probability
    return Finding(
        candidate=Candidate(SEVERAL_ANGULAR_ERRORS, {}, SEVERAL_ANGULAR_ERRORS.name),
        sizes={"size": size},
        standard_uncertainty={"size": spread},
        band={"size": (max(size - factor * spread, 0.0), size + factor * spread)},
        gain=rotations.gain,
        p_value=rotations.p_value,
        probability=probability,
        runners_up=tuple(
            RunnerUp(one.label, one.gain, 1.0 - probability, "explains less of the gap", close)
            for one in rivals
        ),
        covariance=np.array([[spread**2]]),
    )


def beside_rotations(diagnosis: Diagnosis, rotations: RotationTest, ahead: float) -> Diagnosis:
    """Return a diagnosis that says where rotations of all axes cannot be ruled out either."""
    chance = float(np.exp(ahead))
    if not diagnosis.findings or chance * EVIDENCE_RATIO < 1.0:
        return diagnosis
    rival = RunnerUp(
        SEVERAL_ANGULAR_ERRORS.name,
        rotations.gain,
        chance / (1.0 + chance),
        f"lowers χ² by {rotations.gain:.3g} with {rotations.columns} sums of rotations: odds 1 to"
        f" {1.0 / chance:.2g}, too close to rule out",
        ambiguous=True,
    )
    return shaken_by(rival, diagnosis)


def shaken_by(rival: RunnerUp, diagnosis: Diagnosis, place: int = 0) -> Diagnosis:
    """Return a diagnosis of which one finding has one more rival that is not ruled out.

    Args:
        rival: of the finding.
        diagnosis: by the effects of the catalogue.
        place: of the finding.
    """
    shaken = diagnosis.findings[place]
    shaken = replace(shaken, runners_up=(*shaken.runners_up, rival), over=False, equivalent=())
    findings = (*diagnosis.findings[:place], shaken, *diagnosis.findings[place + 1 :])
    verdict, sentence = explained_by(findings)
    return replace(diagnosis, verdict=verdict, sentence=sentence, findings=findings)


def explained_by(chosen: tuple[Finding, ...]) -> tuple[str, str]:
    """Return verdict and sentence where findings close the gap."""
    open_names = [one for one in chosen if one.ambiguous]
    if open_names:
        words = "; ".join(
            f"{one.label}, or as well {', '.join(one.ambiguous)}" for one in open_names
        )
        ends = " or ".join(one.label for one in open_names if one.over)
        over = (
            f" No further measurement distinguishes {ends} from the others: all of them ended with"
            " their alignments. Align those lines again."
        )
        named = " and ".join(_with_equivalents(one) for one in chosen if not one.ambiguous)
        first = f"The model lacks {named}. The rest of the gap" if named else "The gap"
        sentence = f"{first} closes, but this run does not determine by what: {words}."
        return verdicts.AMBIGUOUS, sentence + (over if ends else "")
    words = " and ".join(map(_with_equivalents, chosen))
    return verdicts.NAMED, f"The model lacks {words}; with that, model and run agree."


def _with_equivalents(finding: Finding) -> str:
    if not finding.equivalent:
        return finding.label
    return (
        f"{finding.label} (one with {', '.join(finding.equivalent)}: that alignment is over, and no"
        " further measurement distinguishes them)"
    )
