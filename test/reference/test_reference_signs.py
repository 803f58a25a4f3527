"""The sign of each of the 21 errors in each of the six chains: derived here, not remembered.

``rigid.py`` composes the machine from its bodies; the package's models and solvers must agree.
"""

import numpy as np
import pytest
from rigid import beam_length, moved_by_msl, tool_seen_from_workpiece

from stepdiag_ros.metrology.forward import (
    OVER_90_DEGREES,
    SQUARENESS_DEFINITIONS,
    Alignment,
    ErrorCurves,
    reading,
    reading_first_order,
    tool_point,
)
from stepdiag_ros.metrology.geometry import (
    AXES,
    BODY_DIAGONALS,
    CHAINS,
    ROTATIONS,
    SQUARENESS,
    TRANSLATIONS,
    beam_direction,
)
from stepdiag_ros.metrology.measurement import MeasuredLine, Measurement
from stepdiag_ros.metrology.plan import LINEAR, STEP_DIAGONAL, Line, Volume
from stepdiag_ros.metrology.solvers import solve, solvers

STEP = np.array([0.05, 0.03, 0.04])
BLOCKS = 3
NODES = [STEP[axis] * np.arange(BLOCKS + 1) for axis in range(3)]
OFFSET = np.array([0.02, -0.03, -0.11])
SMALL = 1e-6
LINES = ("x", "y", "z", *BODY_DIAGONALS)


def errors_at(position, name, value):
    """One error that grows in proportion to its axis's way, ``value`` at the far end."""
    made = {axis: np.zeros(6) for axis in AXES}
    axis = AXES.index(name[3])
    share = position[axis] / NODES[axis][-1]
    made[name[3]]["XYZABC".index(name[2])] = value * share
    return made


def curves_of(name, value):
    axis = AXES.index(name[3])
    return ErrorCurves.from_curves(NODES, {name: value * NODES[axis] / NODES[axis][-1]})


@pytest.mark.parametrize("chain", CHAINS)
def test_all_errors_at_once_wherever_the_machine_stands_on_the_floor(chain):
    rng = np.random.default_rng(7)
    values = {name: 1e-3 * rng.standard_normal(BLOCKS + 1) for name in TRANSLATIONS + ROTATIONS}
    for k in range(BLOCKS + 1):
        position = np.array([nodes[k] for nodes in NODES])
        here = {
            axis: np.array([values[f"E_{e}{axis}"][k] for e in "XYZABC"], dtype=float)
            for axis in AXES
        }
        point, rotation = tool_point(
            position[None], ErrorCurves.from_curves(NODES, values), chain, OFFSET
        )
        for floor in range(4):
            pose = tool_seen_from_workpiece(chain, floor, position, here, OFFSET)
            assert point[0] == pytest.approx(pose[:3, 3], abs=2e-16 * 10)
            assert rotation[0] == pytest.approx(pose[:3, :3], abs=1e-14)
            beam = beam_direction("npp", STEP)
            normal = np.array([-0.7, 0.5, 0.4])
            normal /= np.linalg.norm(normal)
            alignment = Alignment(beam, normal, -0.4 * beam)
            found = reading(
                position[None], alignment, ErrorCurves.from_curves(NODES, values), chain, OFFSET
            )[0]
            expected = beam_length(pose, beam, normal, -0.4 * beam)
            assert found == pytest.approx(expected, abs=1e-14)


@pytest.mark.parametrize("chain", CHAINS)
@pytest.mark.parametrize("name", TRANSLATIONS + ROTATIONS)
def test_each_error_moves_tool_and_reading_the_way_the_bodies_say(name, chain):
    position = np.array([nodes[-1] for nodes in NODES])
    perfect = {axis: np.zeros(6) for axis in AXES}
    ideal = tool_seen_from_workpiece(chain, 1, position, perfect)
    pose = tool_seen_from_workpiece(chain, 1, position, errors_at(position, name, SMALL))
    moved = pose[:3, 3] - ideal[:3, 3]
    errors = curves_of(name, SMALL)
    assert tool_point(position[None], errors, chain)[0][0] - position == pytest.approx(
        moved, abs=1e-16 * 3
    )
    seen = 0
    for line in LINES:
        n = beam_direction(line, STEP)
        origin = np.array([0.01, 0.02, -0.03]) - 0.3 * n
        change = beam_length(pose, n, n, origin) - beam_length(ideal, n, n, origin)
        alignment = Alignment(n, n, origin)
        exact = reading(position[None], alignment, errors, chain)[0]
        exact -= reading(position[None], alignment, curves_of(name, 0.0), chain)[0]
        assert exact == pytest.approx(change, abs=5e-16)
        linear = reading_first_order(position[None], n, np.zeros(3), origin, errors, chain)[0]
        linear -= position @ n
        # The second order is the square of the angle times the way.
        assert linear == pytest.approx(change, abs=SMALL**2)
        seen += abs(change) > 1e-9
    assert seen >= 3  # no error is hidden from all these lines: the comparison is one of numbers


def measured(chain, errors_here, plan, mirror=(0.0, 0.0, 0.0)):
    """Measure a machine of bodies along lines; ``errors_here(position)`` gives all its errors."""
    volume = Volume((0.0, 0.0, 0.0), tuple(float(step) for step in STEP), BLOCKS)
    lines = []
    for index, (name, order, offset) in enumerate(plan):
        kind = STEP_DIAGONAL if order else LINEAR
        line = Line(kind, name, order, 0, "forward", offset)
        targets = line.stops(volume)
        n = beam_direction(name, STEP)
        origin = targets[0] + np.asarray(mirror) - 0.3 * n
        values = np.array(
            [
                beam_length(
                    tool_seen_from_workpiece(chain, 2, q, errors_here(q), mirror), n, n, origin
                )
                for q in targets
            ]
        )
        lines.append(
            MeasuredLine(
                line=line,
                line_index=index,
                attempt=1,
                setup=name + str(offset),
                time=np.arange(len(values), dtype=float),
                end_time=index,
                target=targets,
                displacement=values - values[0],
                standard_uncertainty=np.full(len(values), 1e-8),
                environment=np.full((len(values), 4), np.nan),
            )
        )
    return Measurement(volume, tuple(lines), chain)


NONE = (0.0, 0.0, 0.0)
PLAN = [(name, "", NONE) for name in "xyz"] + [(name, "XYZ", NONE) for name in BODY_DIAGONALS]
EDGES = [
    (line, "", tuple(float(v) for v in STEP * BLOCKS * np.array(at)))
    for line, places in {
        "x": ((0, 0, 0), (0, 1, 0), (0, 0, 1), (0, 1, 1)),
        "y": ((0, 0, 0), (1, 0, 0), (0, 0, 1), (1, 0, 1)),
        "z": ((0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)),
    }.items()
    for at in places
]
FULL = EDGES + [(line, order, NONE) for line in BODY_DIAGONALS for order in ("XYZ", "YZX", "ZXY")]
"""All edges of the box, and three move orders of each diagonal in one alignment."""
FRAMED = ("E_YX", "E_ZX", "E_YZ")
"""The frame holds these curves' slopes at zero; given as an arc, they keep their sign."""


@pytest.mark.parametrize("chain", CHAINS)
@pytest.mark.parametrize("name", TRANSLATIONS)
@pytest.mark.parametrize("method", [m for m in solvers() if m not in ("rigid_body", "soons")])
def test_a_positive_translation_gives_a_positive_curve(method, name, chain):
    axis = AXES.index(name[3])

    def shape(share):
        return share * (1.0 - share) * 4.0 if name in FRAMED else share

    def errors_here(position):
        made = errors_at(position, name, 0.0)
        share = position[axis] / NODES[axis][-1]
        made[name[3]]["XYZABC".index(name[2])] = SMALL * shape(share)
        return made

    result = solve(measured(chain, errors_here, PLAN), method)
    expected = SMALL * shape(NODES[axis] / NODES[axis][-1])
    assert np.max(expected) > 0.5 * SMALL
    assert result.curves[name] == pytest.approx(expected, abs=1e-12)
    for other in TRANSLATIONS:
        if other != name:
            assert result.curves[other] == pytest.approx(0.0, abs=1e-12), other


TURNED = {
    # Which axis's line turns, about which axis, by ISO 230-1's name; and the two positive axes.
    "C0Y": ("Y", 2, "X"),
    "B0Z": ("Z", 1, "X"),
    "A0Z": ("Z", 0, "Y"),
}


@pytest.mark.parametrize("chain", CHAINS)
@pytest.mark.parametrize("name", SQUARENESS)
@pytest.mark.parametrize("method", [m for m in solvers() if m != "soons"])
def test_a_positive_squareness_gives_a_positive_figure(method, name, chain):
    from scipy.spatial.transform import Rotation

    letter, about, other = TURNED[name]
    axis = AXES.index(letter)
    angle = 20e-6
    along = Rotation.from_rotvec(angle * np.eye(3)[about]).as_matrix() @ np.eye(3)[axis]

    def errors_here(position):
        made = {one: np.zeros(6) for one in AXES}
        made[letter][:3] = position[axis] * (along - np.eye(3)[axis])
        return made

    plan = FULL if method == "rigid_body" else PLAN
    result = solve(measured(chain, errors_here, plan), method)
    told = SQUARENESS
    if method == "rigid_body":
        # The first axis of the chain may turn as it likes: its angle times the way of another axis
        # looks like a slope. Squareness between the two others is told.
        told = {"X": ("A0Z",), "Y": ("B0Z",), "Z": ("C0Y",)}[chain[0]]
    for further in SQUARENESS:
        expected = angle if further == name else 0.0
        if further not in told:
            assert np.isnan(result.figure(further).value)
            continue
        # The second order of the turn: 1 - cos, over the length.
        assert result.figure(further).value == pytest.approx(expected, abs=angle**2)
    if name not in told:
        return
    # What a square would show: the angle between the positive directions, less a right one.
    opened = np.arccos(along @ np.eye(3)[AXES.index(other)]) - np.pi / 2
    factor = SQUARENESS_DEFINITIONS[OVER_90_DEGREES][name]
    assert factor * result.figure(name).value == pytest.approx(opened, abs=angle**2)


@pytest.mark.parametrize("chain", CHAINS)
@pytest.mark.parametrize("name", ROTATIONS)
@pytest.mark.parametrize("method", [m for m in ("rigid_body", "soons") if m in solvers()])
def test_a_positive_rotation_gives_a_positive_curve_or_none(method, name, chain):
    """Where an angle is determined its sign is that of the bodies; elsewhere it is no number."""

    def errors_here(position):
        return errors_at(position, name, SMALL)

    result = solve(measured(chain, errors_here, FULL), method)
    unseen = [
        other
        for other in ROTATIONS
        if other not in result.curves or not np.all(np.isfinite(result.curves[other]))
    ]
    if method == "rigid_body":
        # Only the roll of the axis next to the workpiece: the levers of the axes after it and the
        # turn of the mirror cancel, but for (ε × n)·(way of this axis), and ε lies along that.
        assert unseen == [f"E_{'ABC'[AXES.index(chain[0])]}{chain[0]}"]
    else:
        assert len(unseen) == 4  # Soons sees five (Ibaraki & Hata 2010, section 3.3)
    for other in ROTATIONS:
        if other not in unseen:
            axis = AXES.index(other[3])
            expected = SMALL if other == name else 0.0
            assert result.curves[other] == pytest.approx(
                expected * NODES[axis] / NODES[axis][-1], abs=1e-3 * SMALL
            ), other


@pytest.mark.parametrize(("bridge", "chain"), [(0, "YXZ"), (1, "XYZ")])
def test_the_convention_of_msls_error_map_is_ours_with_the_letters_swapped(bridge, chain):
    """https://github.com/MSLNZ/ls_cmm_error_map, model_point, machines with a fixed table.

    Its machines with a moving table give the table's own motion, against the foundation: position
    and errors of that axis then have the other sign from ours, which are tool against workpiece.
    """
    rng = np.random.default_rng(3)
    position = np.array([0.3, 0.2, 0.1])
    size = 1e-6
    t = {f"{m}{e}": size * rng.standard_normal() for m in "xyz" for e in "xyz"}
    r = {f"{m}{e}": size * rng.standard_normal() for m in "xyz" for e in "xyz"}
    theirs = moved_by_msl(bridge, position, OFFSET, t, r)
    curves = {f"E_{k[1].upper()}{k[0].upper()}": np.full(2, v) for k, v in t.items()}
    about = {"x": "A", "y": "B", "z": "C"}
    curves.update({f"E_{about[k[1]]}{k[0].upper()}": np.full(2, v) for k, v in r.items()})
    errors = ErrorCurves.from_curves([np.array([0.0, 1.0])] * 3, curves)
    ours = tool_point(position[None], errors, chain, OFFSET)[0][0]
    # They take small angles; the difference is of the second order, the sizes are 1e-6.
    assert ours == pytest.approx(theirs, abs=50 * size**2)
