"""Reads certified problems, and counts matching digits as NIST's StRD does."""

import json
import math
from pathlib import Path

import numpy as np

from stepdiag_ros.metrology.measurement import MeasuredLine, Measurement
from stepdiag_ros.metrology.plan import LINEAR, STEP_DIAGONAL, Line, Volume
from stepdiag_ros.metrology.plausible import NOTHING

FOLDER = Path(__file__).parents[1] / "data" / "reference"
EPSILON = 2.0**-52


def read(name):
    return json.loads((FOLDER / f"{name}.json").read_text())


def names_of(prefix):
    return sorted(path.stem for path in FOLDER.glob(f"{prefix}_*.json"))


def measurement_of(problem, chain=""):
    """Return the measurement that a certified problem poses."""
    volume = Volume(tuple(problem["origin_m"]), tuple(problem["step_m"]), problem["blocks"])
    lines = []
    for index, posed in enumerate(problem["lines"]):
        kind = STEP_DIAGONAL if posed["order"] else LINEAR
        line = Line(kind, posed["name"], posed["order"], posed["repeat"], posed["direction"])
        values = np.array([np.nan if v is None else v for v in posed["reading_m"]])
        own = posed["standard_uncertainty_m"]
        lines.append(
            MeasuredLine(
                line=line,
                line_index=index,
                attempt=1,
                setup=line.setup,
                time=np.arange(len(values), dtype=float),
                end_time=index,
                target=line.stops(volume),
                displacement=values,
                standard_uncertainty=np.full(len(values), np.nan if own is None else own),
                environment=np.full((len(values), 4), np.nan),
            )
        )
    return Measurement(volume, tuple(lines), chain, NOTHING)


def matching_digits(computed, certified, size=None):
    """Return the number of matching decimal digits, at most 16 (NIST's log relative error).

    Args:
        computed: values.
        certified: texts of the certified values.
        size: the errors are counted relative to this; by default to the largest certified value, so
            that a value of a curve near zero does not count as badly computed.
    """
    truth = np.array([float(text) for text in certified])
    scale = float(np.max(np.abs(truth))) if size is None else size
    worst = float(np.max(np.abs(np.asarray(computed, dtype=float) - truth)))
    if not math.isfinite(worst):
        return 0.0
    if worst == 0.0:
        return 16.0
    return min(16.0, -math.log10(worst / scale)) if scale > 0.0 else 0.0


def digits_at_hand(problem):
    """Return how many digits the numbers of a problem allow for.

    A reading is rounded to the next double when it is written, and so is what is computed from it:
    relative 2^-53 of the length of the line. An increment of a curve is ‖a‖/2a times the difference
    of displacements (IH eqs. 6-14).
    """
    step = np.array(problem["step_m"])
    length = np.linalg.norm(step) * problem["blocks"]
    gain = np.linalg.norm(step) / (2.0 * np.min(step))
    return -math.log10(EPSILON * length * gain / problem["size_m"])
