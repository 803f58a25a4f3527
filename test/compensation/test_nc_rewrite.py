"""NC programs rewritten: what a machine with the errors of the map then does."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import settings as tries
from hypothesis import strategies as st
from nc_examples import MILLING, OFFSET, PROGRAM, machine, settings
from refused import a_fault, refused

from stepdiag_ros.compensation.nc_proof import prove
from stepdiag_ros.compensation.nc_reading import NcSettings, steps_of
from stepdiag_ros.compensation.nc_rewrite import HOLD, rewrite
from stepdiag_ros.compensation.nc_words import NcError
from stepdiag_ros.metrology.plausible import NOTHING
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.volumetric_map import VolumetricMap

START = "G54 G0 X0. Y0. Z20.\n"


def tool_ways(text, error_map, points, owner=lambda line: line):
    """Return where the tool goes on feed moves, from the map alone: line → places."""
    places = {}
    for step in steps_of(text, "program", PROGRAM):
        if step.motion is not None and step.motion.known and step.motion.kind != "rapid":
            axes = step.motion.at(np.linspace(0.0, 1.0, points))
            tool = axes + error_map.errors(error_map.nearest(axes))
            places.setdefault(owner(step.block.number), []).append(tool)
    return {line: np.vstack(found) for line, found in places.items()}


def distances(places, way):
    """Return the distance of each place to the polygon of a way."""
    along = np.diff(way, axis=0)
    size = np.maximum(np.sum(along**2, axis=1), 1e-30)
    from_begin = places[:, None, :] - way[None, :-1, :]
    share = np.clip(np.sum(from_begin * along, axis=2) / size, 0.0, 1.0)
    return np.min(np.linalg.norm(from_begin - share[..., None] * along, axis=2), axis=1)


def test_the_tool_of_the_erring_machine_stays_on_the_wanted_way():
    error_map = machine()
    made = rewrite(MILLING, "milling.nc", error_map, settings(tolerance=1e-6))
    # Independent of parts and pieces: the tool's places, and their distance to the programmed way.
    begins = np.array([first for first, _ in made.lines])
    ways = tool_ways(MILLING, machine(0.0), 301)
    before = tool_ways(MILLING, error_map, 41)
    after = tool_ways(made.text, error_map, 5, lambda line: np.searchsorted(begins, line, "right"))
    assert set(ways) == set(before) == set(after) and len(ways) == 8
    assert max(np.max(distances(before[line], ways[line])) for line in ways) > 20e-6
    # The polygon that stands for an arc has sagittas of 0.3 µm itself.
    assert max(np.max(distances(after[line], ways[line])) for line in ways) < 1.3e-6
    proof = prove(MILLING, made, error_map, PROGRAM)
    assert proof.before.largest > 20e-6 > 1e-6 >= proof.after.largest > 0.0
    assert 0.0 < proof.after.rms < proof.after.largest and proof.pieces > proof.moves == 8
    assert proof.rapid_after.largest < 0.1e-6 < proof.rapid_before.largest
    assert np.isnan(proof.map_uncertainty)


def test_the_uncertainty_of_the_map_is_told_beside_the_proof():
    known = machine(rotations=False)
    spread = {name: np.full(7, 3e-7) for name in known.curves}
    certain = VolumetricMap(
        known.nodes, known.curves, standard_uncertainty=spread, plausible=NOTHING
    )
    text = START + "G1 X50. Y50. Z50. F100\n"
    proof = prove(text, rewrite(text, "p", certain, settings()), certain, PROGRAM)
    # Three axes add to each component, at the place and at the first corner, at most.
    assert 3e-7 < proof.map_uncertainty <= np.sqrt(3) * 6 * 3e-7


def test_what_does_not_move_is_passed_sign_by_sign():
    made = rewrite(MILLING, "milling.nc", machine(), settings())
    lines = made.text.split("\n")
    original = MILLING.split("\n")
    for number in (1, 2, 3, 4, 5, 7, 15, 18, 19, 20, 21):
        first, count = made.lines[number - 1]
        assert count == 1 and lines[first - 1] == original[number - 1], number
    # Words beside a move stay: the spindle, coolant on before and off behind the pieces.
    first, count = made.lines[8]
    assert count > 1 and re.fullmatch(r"N60 G1 X\S+ Y\S+ Z\S+ F600 M8", lines[first - 1])
    first, count = made.lines[15]
    assert count > 1 and lines[first + count - 2].endswith("M9") and "M9" not in lines[first - 1]
    assert made.uncorrected == (
        (5, "a rapid move while an axis stands where it is not known"),
        (18, "G28 goes to a reference point"),
    )


def test_a_perfect_machine_gets_the_same_program_with_every_line_ending():
    for end in ("\n", "\r\n"):
        text = MILLING.replace("\n", end)
        made = rewrite(text, "milling.nc", machine(0.0), settings(), header=["not written"])
        assert made.text == text and made.changed == 0
    mixed = "G54 G0 X1 Y1 Z1\r\nG1 X2\nX3\r\n"
    assert rewrite(mixed, "mixed", machine(0.0), settings()).text == mixed


def test_the_header_goes_behind_the_program_s_number():
    made = rewrite(MILLING, "milling.nc", machine(), settings(), header=["from a test", "second"])
    begin = ["%", "O1000 (POCKET)", "(from a test)", "(second)"]
    assert made.text.split("\n")[:4] == begin
    proof = prove(MILLING, made, machine(), PROGRAM)
    assert proof.after.largest <= 2e-6


def test_errors_below_the_tolerance_and_the_resolution_change_nothing():
    made = rewrite(MILLING, "milling.nc", machine(1e-4), settings(tolerance=2e-6))
    assert made.text == MILLING


def test_inches_and_increments_mean_the_same_way():
    millimetres = "G21 G90 G54 G0 X0. Y0. Z25.4\nG1 X25.4 Y12.7 Z50.8 F100\nX50.8\n"
    inches = "G20 G90 G54 G0 X0. Y0. Z1.\nG1 X1. Y.5 Z2. F4\nX2.\n"
    increments = "G21 G90 G54 G0 X0. Y0. Z25.4\nG91 G1 X25.4 Y12.7 Z25.4 F100\nX25.4\n"
    error_map = machine()
    ends = []
    for text in (millimetres, inches, increments):
        made = rewrite(text, "program", error_map, settings(tolerance=1e-6))
        proof = prove(text, made, error_map, PROGRAM)
        assert proof.after.largest <= 1e-6 < proof.before.largest
        steps = [step.motion for step in steps_of(made.text, "made", PROGRAM) if step.motion]
        ends.append(steps[-1].end)
    assert ends[0] == pytest.approx(ends[1], abs=2e-7)
    assert ends[0] == pytest.approx(ends[2], abs=2e-7)


def test_increments_do_not_add_up_their_rounding():
    text = "G90 G54 G0 X0. Y0. Z20.\nG91\n" + "G1 X0.37 Y0.21 F100\n" * 60
    made = rewrite(text, "program", machine(), settings(tolerance=1e-6))
    assert prove(text, made, machine(), PROGRAM).after.largest <= 1e-6


def test_a_mode_that_was_written_out_is_told_again_where_it_goes_on():
    known = machine(0.0)
    curves = dict(known.curves)
    # Errors of X before 200 mm of the machine alone, that is 50 mm of the program.
    curves["E_YX"] = np.array([0.0, 2e-5, 0.0, 0.0, 0.0, 0.0, 0.0])
    partly = VolumetricMap(known.nodes, curves, chain="YXZ")
    text = "G54 G0 X0. Y50. Z20.\nG2 X60. Y50. I30. J0.\nN3 X80. I10. (goes on)\nG1 X90.\n"
    made = rewrite(text, "p", partly, settings(tolerance=1e-6))
    assert made.lines[1][1] > 20 and made.text.splitlines()[-2:] == [
        "N3 G2 X80. I10. (goes on)",
        "G1 X90.",
    ]
    assert prove(text, made, partly, PROGRAM).after.largest <= 1e-6


def test_machine_coordinates_and_another_system():
    text = "G54 G0 X0. Y0. Z20.\nG53 G1 X300. Y-100. Z-200. F100\nG55 X20. Y0. Z0.\nX30.\n"
    made = rewrite(text, "program", machine(), settings(tolerance=1e-6))
    assert prove(text, made, machine(), PROGRAM).after.largest <= 1e-6
    moved = [line for line in made.text.splitlines() if "G53" in line]
    assert len(moved) == made.lines[1][1] and len(moved) > 1
    assert all(line.startswith("G53 G1 ") for line in moved)


def test_the_tool_length_places_the_axis_where_it_really_stands():
    error_map = machine()
    with_tool = "G54 G0 X0. Y0.\nG43 H1 Z60.\nG1 X20. F100\n"
    without = "G54 G0 X0. Y0.\nZ80.\nG1 X20. F100\n"
    ways = [
        [s.motion.at(np.array([0.0, 1.0])) for s in steps_of(text, "p", PROGRAM) if s.motion][-1]
        for text in (
            rewrite(with_tool, "a", error_map, settings()).text,
            rewrite(without, "b", error_map, settings()).text,
        )
    ]
    assert ways[0] == pytest.approx(ways[1], abs=1e-12)


def test_outside_the_box_is_refused_or_held_and_said():
    text = "G54 G0 X0. Y0. Z20.\nG1 X30. F100\nG0 Z400.\nG1 Z20.\n"
    with refused(NcError, "out_of_range", "p.nc", row=3):
        rewrite(text, "p.nc", machine(), settings())
    made = rewrite(text, "p.nc", machine(), settings(outside=HOLD))
    assert made.held == (3, 4)
    proof = prove(text, made, machine(), PROGRAM)
    assert proof.after.largest <= 2e-6


def test_where_the_errors_are_not_known_is_refused():
    known = machine()
    holes = dict(known.curves)
    holes["E_ZX"] = np.where(np.arange(7) >= 3, np.nan, holes["E_ZX"])
    partly = VolumetricMap(known.nodes, holes, chain="YXZ")
    near = "G54 G0 X0. Y0. Z20.\nG1 X10. F100\n"
    assert rewrite(near, "p.nc", partly, settings()).changed
    with refused(NcError, "undetermined", "E_ZX", row=2):
        rewrite("G54 G0 X0. Y0. Z20.\nG1 X100. F100\n", "p.nc", partly, settings())


def test_canned_cycles_pass_when_allowed_and_are_said():
    text = "G54 G0 X0. Y0. Z20.\nG81 X10. Y10. Z2. R5. F100\nX20.\nG80\nG0 X0. Y0. Z30.\nG1 X5.\n"
    with refused(NcError, "unsupported", "G81", "--cycles", row=2):
        rewrite(text, "p", machine(), settings())
    allowed = replace(PROGRAM, cycles=True)
    made = rewrite(text, "p", machine(), settings(program=allowed))
    assert [line for line, _ in made.uncorrected] == [2, 3]
    assert made.text.splitlines()[1:4] == text.splitlines()[1:4]
    assert prove(text, made, machine(), allowed).after.largest <= 2e-6


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (START + "G41 D1\n", a_fault("unsupported", "G41", row=2)),
        (START + "G68 X0 Y0 R30\n", a_fault("unsupported", "G68", row=2)),
        (START + "G92 X0\n", a_fault("unsupported", "G92", row=2)),
        (START + "G93 G1 X5 F2\n", a_fault("unsupported", "G93", row=2)),
        (START + "G31 Z5 F10\n", a_fault("unsupported", "G31", row=2)),
        (START + "G5.1 Q1\n", a_fault("unsupported", "G5.1", row=2)),
        (START + "M98 P100\n", a_fault("unsupported", "M98", row=2)),
        (START + "O2000\nO3000\n", a_fault("unsupported", row=3)),
        (START + "o100 sub\n", a_fault("malformed", "sub", row=2, aspect="word")),
        (START + "#1=5\n", a_fault("malformed", "#1=5", row=2, aspect="word")),
        (START + "G1 X[1+2]\n", a_fault("malformed", "X[1+2]", row=2, aspect="word")),
        (START + "G1 X=R1\n", a_fault("malformed", "X=R1", row=2, aspect="word")),
        (START + "L X+10 Y+5 FMAX\n", a_fault("malformed", row=2, aspect="word")),
        (START + "G1 X5 A90\n", a_fault("unsupported", "A", row=2, aspect="word")),
        (START + "B90\n", a_fault("unsupported", "X", "Y", "Z", row=2, aspect="axes")),
        (START + "/G1 X5 F100\n", a_fault("unsupported", row=2, aspect="skip")),
        (START + "G1 X5 X6\n", a_fault("twice", "X", row=2)),
        (START + "G1 G2 X5\n", a_fault("mismatch", "G1", "G2", row=2, aspect="modes")),
        (START + "G2 X10. Y0. I4. J0.\n", a_fault("mismatch", "4.0000", row=2, aspect="radius")),
        (START + "G2 X10. Y0. R4.\n", a_fault("out_of_range", row=2, aspect="radius")),
        (START + "G2 X10. Y0.\n", a_fault("missing", "J", "K", "R", row=2, aspect="centre")),
        (START + "G2 X10. Y0. I5. K1.\n", a_fault("mismatch", "J", "K", row=2, aspect="plane")),
        (START + "G2 X10. Y0. I5. R5.\n", a_fault("mismatch", "R", row=2, aspect="R")),
        (START + "G2 R5.\n", a_fault("mismatch", row=2, aspect="end")),
        (START + "G1 X5. I5.\n", a_fault("mismatch", "J", "K", "R", row=2, aspect="straight")),
        (START + "G1 X50. Y50. M123 F100\n", a_fault("mismatch", "M123", row=2, aspect="division")),
        (
            START + "G59 G1 X5\n",
            a_fault("undetermined", "G59", "--offset", "G59=X", "Y", "Z", row=2, aspect="zero"),
        ),
        (
            START + "G43 H7 Z50\n",
            a_fault("undetermined", "G43", "H7", "--tool-length", row=2, aspect="length"),
        ),
        (START + "G91 G53 G0 X5\n", a_fault("unsupported", "G53", row=2)),
        (START + "G1 X5 (not closed\n", a_fault("malformed", row=2, aspect="comment")),
        ("G54 X5 Y5\n", a_fault("undetermined", row=1, aspect="mode")),
        ("G54 G1 X5 Y5 F100\n", a_fault("undetermined", "X", "Y", "Z", row=1, aspect="start")),
        (START + "T2 M6 G0 X5\n", a_fault("unsupported", row=2, aspect="tool")),
        (START + "T2 M6\nG1 X5\n", a_fault("undetermined", "X", "Y", "Z", row=3, aspect="start")),
    ],
)
def test_what_cannot_be_corrected_safely_is_refused_with_its_line(text, said):
    with refused(NcError, said) as caught:
        rewrite(text, "p.nc", machine(), settings())
    assert str(caught.value).startswith("p.nc, line ") and "\n" not in str(caught.value)


def test_a_cut_that_begins_uncorrected_is_refused():
    began = replace(PROGRAM, start=tuple(np.array(OFFSET) + 0.1))
    text = "G54 G1 X50. Y50. Z50. F100\n"
    with refused(NcError, "out_of_range", "2", "G0", row=1):
        rewrite(text, "p", machine(), settings(program=began))
    assert rewrite("G0 " + text.replace("G1 ", "G54 "), "p", machine(), settings(program=began))


def test_a_tolerance_below_what_the_decimals_can_say_is_refused():
    with refused(Refusal, "out_of_range", "0.1", "4", "0.15"):
        rewrite(START, "p", machine(), settings(tolerance=1e-7))
    assert rewrite(START, "p", machine(), settings(tolerance=1e-7, decimals=5)).text


def test_numbers_without_a_point_are_written_with_one_and_said():
    made = rewrite("G54 G0 X10 Y0 Z20\n", "p", machine(), settings())
    assert any("no decimal point" in remark for remark in made.remarks)
    assert re.findall(r"[XYZ](\S+)", made.text) and all(
        "." in number for number in re.findall(r"[XYZ](\S+)", made.text)
    )


coordinates = st.tuples(
    st.floats(0.0, 240.0).map(lambda value: round(value, 3)),
    st.floats(0.0, 140.0).map(lambda value: round(value, 3)),
    st.floats(0.0, 240.0).map(lambda value: round(value, 3)),
)
moves = st.lists(
    st.tuples(st.sampled_from(["G0", "G1", "G1", "arc"]), coordinates, st.booleans()),
    min_size=1,
    max_size=8,
)


@tries(max_examples=8)
@example(moves=[("G1", (240.0, 0.0, 0.0), False)], scale=1.875, seed=7)
@given(moves=moves, scale=st.floats(0.0, 2.0), seed=st.integers(0, 9))
def test_any_program_keeps_the_tolerance_on_any_machine(moves, scale, seed):
    error_map = machine(scale, seed=seed)
    x, y, z = 10.0, 10.0, 10.0
    lines = [f"G90 G54 G0 X{x} Y{y} Z{z}"]
    for code, (to_x, to_y, to_z), incremental in moves:
        if code == "arc":
            # Half a circle in the plane of X and Y, with a pitch along Z.
            to_x, to_y = round(250.0 - x, 3), y
            center = round((to_x - x) / 2.0, 4)
            if abs(center) < 1.0 or not abs(center) < y < 140.0 - abs(center):
                continue
            lines.append(f"G90 G2 X{to_x:.4f} Y{to_y:.4f} Z{to_z:.4f} I{center:.4f} J0. F500")
        elif incremental:
            lines.append(f"G91 {code} X{to_x - x:.4f} Y{to_y - y:.4f} Z{to_z - z:.4f} F500")
        else:
            lines.append(f"G90 {code} X{to_x:.4f} Y{to_y:.4f} Z{to_z:.4f} F500")
        x, y, z = to_x, to_y, to_z
    text = "\n".join(lines) + "\n"
    made = rewrite(text, "program", error_map, settings(tolerance=1e-6))
    proof = prove(text, made, error_map, PROGRAM)
    if proof.moves:
        assert proof.after.largest <= 1e-6
    assert not proof.rapid_after.largest > 0.1e-6
    # Once more through it: the same, so nothing was lost on the way.
    assert rewrite(text, "program", error_map, settings(tolerance=1e-6)).text == made.text


def test_the_settings_default_to_refusing():
    assert NcSettings().cycles is False and settings().outside == "refuse"


_CODES = (0, 1, 2, 3, 17, 18, 20, 21, 28, 43, 49, 53, 54, 80, 81, 90, 91, 90.1, 4)
_OTHERS = """M3 M6 M30 N1 F1 H1 X1. X-5 Y2. Y.5 Z3 Z50. I1. J-2 K3 R4 R-9. L2 P1 A1 E O1 % / # [ =
( ) (a) ; X99999999999"""
_WORDS = st.sampled_from([*(f"G{code:g}" for code in _CODES), *_OTHERS.split()])


@tries(max_examples=60)
@given(
    rows=st.lists(st.lists(_WORDS, max_size=5).map(" ".join), max_size=6),
    cycles=st.booleans(),
    begin=st.sampled_from(["", START, START + "G2 "]),
)
def test_any_words_are_refused_in_one_sentence_or_rewritten(rows, cycles, begin):
    text = begin + "\n".join(rows)
    program = replace(PROGRAM, cycles=cycles)
    try:
        made = rewrite(text, "p", machine(), settings(program=program, outside=HOLD))
    except NcError as error:
        assert str(error).startswith("p, line ") and "\n" not in str(error)
    else:
        proof = prove(text, made, machine(), program)
        assert not proof.after.largest > 2e-6
