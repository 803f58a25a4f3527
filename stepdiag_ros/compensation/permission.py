"""Whether tables may be made of errors, by what the diagnosis of their run says.

Error curves that are solved while something else acts have a part of it in them. Tables made of
them carry that part into the machine, and what acts goes on acting. So tables are refused where the
run shows more than they hold, unless the user takes that upon himself.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from stepdiag_ros.bags.passes import Completeness
from stepdiag_ros.compensation.control import Control
from stepdiag_ros.compensation.identified import Identified
from stepdiag_ros.metrology.discrepancy.findings import DESCRIBED, NOT_TESTABLE, UNEXPLAINED
from stepdiag_ros.metrology.discrepancy.summary import NOT_DIAGNOSED, Verdict
from stepdiag_ros.metrology.effects.axis_scale import EFFECT as SCALE
from stepdiag_ros.metrology.effects.backlash import EFFECT as BACKLASH
from stepdiag_ros.metrology.effects.squareness import EFFECT as SQUARENESS_ERROR
from stepdiag_ros.metrology.geometry import AXES, ROTATIONS, SQUARENESS

DESPITE = "--despite-verdict"
LEARN_FIRST = (
    "What depends on places alone is compensated if a model holds it ('stepdiag diagnose"
    " --extend MODEL', then --model MODEL)"
)
_ANGULAR = "angular error"
_ROTATIONS_STAY = (
    "tables hold no rotations of axes; what these do away from the corner of the error curves"
    " stays, and the stated uncertainties contain it"
)


_IN_CURVES = (
    *(SQUARENESS_ERROR.label({"angle": name}) for name in SQUARENESS),
    *(SCALE.label({"axis": axis}) for axis in AXES),
)


@dataclass(frozen=True)
class TablePermission:
    """Whether tables may be made.

    Attributes:
        refusal: why not, in words; empty if they may.
        warnings: what speaks against them all the same, in words.
    """

    refusal: str = ""
    warnings: tuple[str, ...] = ()


def permission(
    identified: Identified,
    control: Control | None = None,
    settings: Mapping[str, Any] | None = None,
) -> TablePermission:
    """Judge by the verdict on a run whether tables may be made of its errors.

    Refused are UNEXPLAINED and DESCRIBED, and every effect that was NAMED, or may act where
    AMBIGUOUS, that is not in the tables (``not_held``). Rotations that the uncertainties contain,
    NOT TESTABLE, a run without a verdict and one that was cut short are warned of.

    Args:
        identified: the errors.
        control: that tables are made for; None: targets are corrected by the error map.
        settings: of the control, checked.
    """
    verdict, overruled = identified.verdict, identified.origin.despite_verdict
    if overruled:
        return TablePermission(f"these errors were taken over despite the verdict {overruled}")
    if verdict.name in (UNEXPLAINED, DESCRIBED):
        how = f". {LEARN_FIRST}" if verdict.name == DESCRIBED else ""
        return TablePermission(
            f"the verdict on the run is {verdict.name}: {verdict.sentence.rstrip('.')}{how}"
        )
    reversal = control is not None and control.holds_reversal(settings or {})
    left = not_held(verdict, identified, reversal)
    if left and not verdict.contained:
        return TablePermission(
            f"the verdict on the run is {verdict.name}, and {', '.join(left)} would not be in the"
            " tables, and a part of that may be in the error curves that they are made of"
        )
    rotating = [f"{', '.join(left)}: {_ROTATIONS_STAY}"] if left else []
    return TablePermission(warnings=(*rotating, *_warnings(verdict, identified.passes)))


def not_held(verdict: Verdict, identified: Identified, reversal: bool) -> tuple[str, ...]:
    """Return the effects that act, or may act, and that tables would not hold.

    Geometric are squareness and scale, which are in the curves; angular errors, where the errors
    were solved with these rotations; backlash, where the tables hold reversal errors and those of
    that axis are known from linear lines measured in both directions.

    Args:
        verdict: on the run.
        identified: the errors.
        reversal: the tables correct reversal errors.
    """
    axes = [AXES[axis] for axis in identified.reversal] if reversal else []
    held = {*_IN_CURVES, *(BACKLASH.label({"axis": axis}) for axis in axes)}
    return tuple(
        label
        for label in (*verdict.effects, *verdict.rivals)
        if label not in held and not _solved_with(label, identified)
    )


def held_by_any(verdict: Verdict) -> bool:
    """Say whether some control's tables hold all that was named, if its reversal is measured."""
    held = {*_IN_CURVES, *(BACKLASH.label({"axis": axis}) for axis in AXES)}
    return {*verdict.effects, *verdict.rivals} <= held


def _solved_with(label: str, identified: Identified) -> bool:
    """Say whether an angular error is among the rotations that the errors were solved with."""
    if _ANGULAR not in label:
        return False
    curves = identified.error_map.curves
    names: Sequence[str] = [name for name in ROTATIONS if name in label] or ROTATIONS
    return all(name in curves and bool(np.all(np.isfinite(curves[name]))) for name in names)


def _warnings(verdict: Verdict, passes: Completeness | None) -> list[str]:
    said = []
    if passes is not None and not passes.whole:
        said.append(
            f"the run is not complete, {passes.complete} of {passes.planned} planned passes have"
            " every stop"
        )
    if verdict.name in (NOT_TESTABLE, NOT_DIAGNOSED):
        said.append(f"{verdict.name}, so nothing speaks for these errors: {verdict.sentence}")
    return said
