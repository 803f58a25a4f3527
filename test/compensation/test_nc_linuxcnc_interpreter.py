"""How programs are read, beside LinuxCNC's own interpreter (``rs274``), where that is installed."""

import re
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from nc_examples import PROGRAM, machine, settings

from stepdiag_ros.compensation.nc_reading import NcSettings, steps_of
from stepdiag_ros.compensation.nc_rewrite import rewrite

pytestmark = pytest.mark.skipif(shutil.which("rs274") is None, reason="LinuxCNC is not installed")

EVERYTHING = """%
N10 G21 G17 G90 G40 G80 G49
N30 G54 G0 X10. Y5. S3000 M3
N40 Z60.
(first cut)
N50 G1 Z20.5 F200
N60 X120. Y80. F600 M8
N70 G2 X140. Y60. I0. J-20.
N80 G3 X120.0 Y40. R20.
N85 G2 X100. Y40. Z22. R-15.
N90 G1 X10.
N100 G91 X30. Y-10. ; incremental
N105 G3 X10. Y10. J10.
N106 G2 X-10. Y-10. R10.
N110 G90 G18 G2 X50. Z32. I10. K0.
N115 G19 G3 Y34.5 Z36.5 J0. K4.5
N116 G2 Y40. Z42. R-8.
N120 G17 G4 P1.5
N125 G2 I5. J0.
N126 G3 Z50. I-3. J4.
N127 G90.1 G3 X55. Y45. I50. J45.
N130 G91.1 G1 X200. Y30. M9
N140 G20 G0 Z5.
N150 G53 G1 X3. F10.
N155 G2 X3.5 Y1.5 R1.
N160 M5
M2
%
"""
_AXES_OF_PLANE = {"XY": (0, 1, 2), "XZ": (2, 0, 1), "YZ": (1, 2, 0)}
_CALL = re.compile(
    r"(STRAIGHT_TRAVERSE|STRAIGHT_FEED|ARC_FEED|SELECT_PLANE|USE_LENGTH_UNITS)\((.*)\)"
)


def of_linuxcnc(text, folder):
    """Return the ends of LinuxCNC's moves in m, and center and sense of its arcs."""
    (folder / "program.ngc").write_text(text)
    done = subprocess.run(
        ["rs274", "-g", "program.ngc"], cwd=folder, capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, done.stdout[-500:] + done.stderr
    unit, plane, moves = 1e-3, "XY", []
    for call, inside in _CALL.findall(done.stdout):
        if call == "USE_LENGTH_UNITS":
            unit = 25.4e-3 if "INCH" in inside else 1e-3
        elif call == "SELECT_PLANE":
            plane = inside.removeprefix("CANON_PLANE_")
        else:
            values = [float(value) for value in inside.split(",")]
            if call != "ARC_FEED":
                moves.append((unit * np.array(values[:3]), None))
                continue
            first, second, third = _AXES_OF_PLANE[plane]
            end = np.empty(3)
            end[[first, second, third]] = unit * np.array([values[0], values[1], values[5]])
            moves.append((end, (unit * np.array(values[2:4]), int(values[4]))))
    return moves


def ours(text, program):
    return [step.motion for step in steps_of(text, "program", program) if step.motion is not None]


def agree(moves, theirs):
    assert len(moves) == len(theirs)
    for motion, (end, arc) in zip(moves, theirs, strict=True):
        # LinuxCNC prints four decimals, of millimetres or inches.
        assert motion.end == pytest.approx(end, abs=1.5e-6)
        assert (motion.arc is None) == (arc is None)
        if arc is not None:
            assert motion.arc.center == pytest.approx(arc[0], abs=2e-6)
            assert np.sign(motion.arc.sweep) == arc[1]
            assert motion.at(np.array([1.0]))[0] == pytest.approx(end, abs=2e-6)


def test_every_move_is_read_as_linuxcnc_reads_it(tmp_path):
    # A control that was just switched on stands at zero for LinuxCNC's interpreter.
    program = NcSettings(offsets={"G54": (0.0, 0.0, 0.0)}, start=(0.0, 0.0, 0.0))
    moves = ours(EVERYTHING, program)
    assert sum(motion.arc is not None for motion in moves) == 12
    agree(moves, of_linuxcnc(EVERYTHING, tmp_path))


def test_a_rewritten_program_is_one_that_linuxcnc_runs_with_the_same_moves(tmp_path):
    text = EVERYTHING.replace("N150 G53 G1 X3.", "N150 G1 X3.").replace("S3000 M3", "Z60. M3")
    made = rewrite(text, "program", machine(), settings(tolerance=3e-6, outside="hold"))
    assert made.changed > 15
    shifted = replace(PROGRAM, offsets={"G54": (0.0, 0.0, 0.0)}, start=(0.0, 0.0, 0.0))
    moves = ours(made.text, shifted)
    assert all(motion.arc is None for motion in moves) and len(moves) > 100
    agree(moves, of_linuxcnc(made.text, tmp_path))
