"""A small report made by hand: what the tests of tables, pictures and documents are fed with."""

import math
from dataclasses import replace

import numpy as np

from stepdiag_ros.evaluation.report import Report, Truth
from stepdiag_ros.metrology.geometry import ROTATIONS, SQUARENESS, TRANSLATIONS
from stepdiag_ros.metrology.measurement import MeasuredLine, Measurement
from stepdiag_ros.metrology.plan import Line, Volume
from stepdiag_ros.metrology.solvers.result import Figure, VolumetricErrors

BLOCKS = 3
VOLUME = Volume(origin=(0.0, 0.1, -0.2), step=(0.01, 0.02, 0.03), blocks=BLOCKS)


def true_curves():
    share = np.arange(BLOCKS + 1) / BLOCKS
    return {name: (number + 1) * 1e-7 * share for number, name in enumerate(TRANSLATIONS)}


def make_result(method="least_squares", shift=0.0, uncertainty=5e-8):
    """Return the truth, shifted by ``shift`` (m) at every node but the first."""
    moved = np.r_[0.0, np.full(BLOCKS, shift)]
    known = np.r_[0.0, np.full(BLOCKS, uncertainty)]
    figures = [
        *(Figure(name, 1.234567e-5, 2.5e-7, "rad") for name in SQUARENESS),
        *(Figure(f"positioning {name}", -1.2e-6, 6e-8, "m") for name in ("E_XX", "E_YY", "E_ZZ")),
        Figure("straightness E_YX", 4e-7, math.nan, "m"),
        Figure("tilt ppp XYZ 1", -1.5e-4, 3e-7, "rad"),
    ]
    return VolumetricErrors(
        method=method,
        nodes=VOLUME.all_nodes,
        curves={name: curve + moved for name, curve in true_curves().items()},
        standard_uncertainty={name: known.copy() for name in TRANSLATIONS},
        figures=tuple(figures),
        lines=12,
        chi_squared=42.0,
        degrees_of_freedom=40,
        remarks=("noise taken from the readings",),
    )


def true_rotations():
    share = np.arange(BLOCKS + 1) / BLOCKS
    return {name: (number + 1) * 1e-6 * share for number, name in enumerate(ROTATIONS)}


def with_rotations(result, shift=0.0, uncertainty=2e-6, unknown=("E_BY",)):
    """Return the result with rotations beside the translations, some of them not determined."""
    moved = np.r_[0.0, np.full(BLOCKS, shift)]
    known = np.r_[0.0, np.full(BLOCKS, uncertainty)]
    curves = {name: curve + moved for name, curve in true_rotations().items()}
    spread = {name: known.copy() for name in ROTATIONS}
    for name in unknown:
        curves[name] = np.r_[0.0, np.full(BLOCKS, np.nan)]
        spread[name] = np.r_[0.0, np.full(BLOCKS, np.nan)]
    return replace(
        result,
        method="rigid_body",
        curves={**result.curves, **curves},
        standard_uncertainty={**result.standard_uncertainty, **spread},
        figures=(*result.figures, Figure("angular E_AX", 1.5e-5, 1e-6, "rad")),
    )


def with_unknown(result, name="E_YZ"):
    """Return the result with one curve that could not be determined."""
    nothing = np.full(BLOCKS + 1, np.nan)
    return replace(
        result,
        curves={**result.curves, name: nothing},
        standard_uncertainty={**result.standard_uncertainty, name: nothing},
        figures=(*result.figures, Figure(f"straightness {name}", math.nan, math.nan, "m")),
        not_determined=(f"{name}: no line tells it",),
    )


def make_measurement():
    lines = []
    for index, (name, order) in enumerate((("x", ""), ("ppp", "XYZ"))):
        for direction in ("forward", "backward"):
            line = Line("step_diagonal" if order else "linear", name, order, 0, direction)
            stops = line.stops(VOLUME)
            count = len(stops)
            path = np.arange(count) * 0.01
            lines.append(
                MeasuredLine(
                    line=line,
                    line_index=index,
                    attempt=1,
                    setup=line.setup,
                    time=np.arange(count) * 1.0,
                    end_time=count,
                    target=stops,
                    displacement=path if direction == "forward" else path[::-1],
                    standard_uncertainty=np.full(count, 1e-7),
                    environment=np.full((count, 4), np.nan),
                )
            )
    return Measurement(VOLUME, tuple(lines))


def make_report(**changes):
    report = Report(
        results=(
            make_result("conventional", shift=2e-5),
            make_result("setup_robust", shift=6e-8),
            make_result("least_squares", shift=2e-8),
        ),
        run_id="20260102T030405-abcd",
        plan="a plan",
        machine="a machine",
        chain="YXZ",
        run_software_version="0.1.0",
        simulated=True,
        truth=Truth(VOLUME.all_nodes, true_curves(), figures=(Figure("C0Y", 1.2e-5, 0.0, "rad"),)),
        equals_recorded={"least_squares": True},
    )
    return replace(report, **changes)
