"""From errors and uncertainties of many machines to shares with their bounds, and the table."""

import math

import numpy as np
from band_rows import NORMAL_95

RIGHT, WIDE, NARROW, UNKNOWN = "right", "wide", "too narrow", "unknown"
NOT_REFUTED = "not refuted"
"""The bounds allow less than the share of a right interval: too few values to know."""
AT_LEAST, AT_MOST = 0.93, 0.97
ROUNDING = 1e-15
"""m or rad: an error so small is none, and may have no uncertainty."""


def counted(errors, uncertainties):
    """Return inside, known, unknown and the sum of z² of one row of one machine."""
    known = np.isfinite(errors) & np.isfinite(uncertainties)
    error, spread = np.abs(errors[known]), uncertainties[known]
    with np.errstate(divide="ignore"):
        z = np.divide(error, spread, out=np.zeros_like(error), where=error > ROUNDING)
    return np.array(
        [np.count_nonzero(z <= NORMAL_95), len(error), len(errors) - len(error), np.sum(z**2)]
    )


def summaries(found):
    """Return row → ``summary`` of the counts of its machines."""
    return {row: summary(machines) for row, machines in found.items()}


def summary(machines):
    """Return share inside with its 95 % bounds, rms z, share unknown, and what that says.

    Machines are independent of each other, the values of one machine are not: the variance of the
    share is that of a ratio over machines (Cochran, Sampling Techniques, 6.3), and the bounds are
    Wilson's for as many independent values as have this variance, at most one a machine where no
    value, or every one, is inside.

    Args:
        machines: of ``counted``, shape (machines, 4).
    """
    inside, known, unknown, squares = machines.T
    total, number = np.sum(known), np.count_nonzero(known)
    made = {"share": math.nan, "low": math.nan, "high": math.nan, "rms_z": math.nan}
    made = {**made, "unknown": float(np.sum(unknown) / np.sum(known + unknown)), "says": UNKNOWN}
    if not total:
        return made
    share = np.sum(inside) / total
    variance = np.sum((inside - share * known) ** 2) / total**2 * number / max(number - 1, 1)
    size = min(share * (1.0 - share) / variance, total) if variance > 0.0 else number
    low, high = _wilson(share, size)
    says = _judged(round(low, 3), round(high, 3))
    made.update(share=float(share), low=float(low), high=float(high), says=says)
    return {**made, "rms_z": float(np.sqrt(np.sum(squares) / total))}


def _judged(low, high):
    """Return the word for bounds, as they are printed."""
    if high < AT_LEAST:
        return NARROW
    if low > AT_MOST:
        return WIDE
    return RIGHT if low >= AT_LEAST else NOT_REFUTED


def _wilson(share, size):
    square = NORMAL_95**2
    middle = (share + square / (2.0 * size)) / (1.0 + square / size)
    half = NORMAL_95 * math.sqrt(share * (1.0 - share) / size + square / (4.0 * size**2))
    return middle - half / (1.0 + square / size), middle + half / (1.0 + square / size)


def as_table(found):
    """Return the table of summaries, Markdown."""
    lines = [
        "| estimator: values | inside U | 95 % bounds | rms of z | unknown | the band is |",
        "|---|---|---|---|---|---|",
    ]
    for row, one in found.items():
        unknown = f"{100.0 * one['unknown']:.0f} %"
        if one["says"] == UNKNOWN:
            lines.append(f"| {row} | – | – | – | {unknown} | {UNKNOWN} |")
            continue
        share = f"{100.0 * one['share']:.1f} %"
        bounds = f"{100.0 * one['low']:.1f}-{100.0 * one['high']:.1f} %"
        cells = (row, share, bounds, f"{one['rms_z']:.2f}", unknown, one["says"])
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)
