"""What must not change when the same measurement is told in another way (hypothesis)."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from stepdiag_ros.metrology.cell import Misalignment, SimulatedCell
from stepdiag_ros.metrology.forward import (
    SQUARENESS_SLOPES,
    Alignment,
    ErrorCurves,
    in_result_frame,
    reading,
    reading_first_order,
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
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.plan import Plan, Volume
from stepdiag_ros.metrology.plausible import NOTHING
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.solvers import solve, solvers

METHODS = tuple(solvers())
ROBUST = tuple(m for m in METHODS if m not in ("conventional", "soons", "rigid_body"))
FEW = settings(
    max_examples=5,
    suppress_health_check=list(HealthCheck),
    # Numbers that fail are as good as smaller ones; looking for these takes minutes.
    phases=(Phase.explicit, Phase.reuse, Phase.generate),
)
seeds = st.integers(0, 2**31)


def machine(seed, blocks=3, rotation=0.0, noise=1e-7, tilt=1e-4, size=2e-6):
    """Return a measurement of a random machine: three orders, both ways, two repeats."""
    rng = np.random.default_rng(seed)
    step = tuple(float(s) for s in rng.integers(10, 60, 3) * 1e-3)
    origin = tuple(float(o) for o in rng.integers(-500, 500, 3) * 1e-3)
    volume = Volume(origin, step, blocks)
    nodes = volume.all_nodes
    curves = {name: size * rng.standard_normal(blocks + 1) for name in TRANSLATIONS}
    curves.update({name: rotation * rng.standard_normal(blocks + 1) for name in ROTATIONS})
    cell = SimulatedCell(
        name="random",
        chain=str(rng.choice(CHAINS)),
        errors=ErrorCurves.from_curves(nodes, curves),
        seed=seed,
        misalignment=Misalignment(beam_sigma=tilt),
        reading_noise=noise,
    )
    return volume, cell


def measure(volume, cell, seed=1, repeats=2, orders=("XYZ", "YZX", "ZXY")):
    plan = Plan.from_mapping(
        {
            "origin_m": list(volume.origin),
            "step_m": list(volume.step),
            "blocks": volume.blocks,
            "repeats": repeats,
            "directions": ["forward", "backward"],
            "feed_m_per_s": 0.1,
            "lines": [
                {"kind": "linear", "names": ["x", "y", "z"]},
                {
                    "kind": "step_diagonal",
                    "names": list(BODY_DIAGONALS),
                    "orders": list(orders),
                },
            ],
        },
        "plan",
    )
    return simulate(plan, cell, seed)


def agree(one, other, tolerance=1e-12, names=None):
    """Two results are the same, NaN where NaN; angles within the tolerance over 10 mm."""
    for name in names or one.curves:
        size = 0.01 if name in ROTATIONS else 1.0
        assert other.curves[name] == pytest.approx(
            one.curves[name], abs=tolerance / size, nan_ok=True
        ), name
        assert other.standard_uncertainty[name] == pytest.approx(
            one.standard_uncertainty[name], rel=1e-6, abs=tolerance / size, nan_ok=True
        ), name
    for figure in one.figures:
        if figure.name in SQUARENESS:
            assert other.figure(figure.name).value == pytest.approx(
                figure.value, abs=tolerance / 0.01, nan_ok=True
            )


@pytest.mark.parametrize("method", METHODS)
@FEW
@given(seed=seeds)
def test_the_order_of_lines_repeats_and_names_of_setups_do_not_matter(method, seed):
    measured = measure(*machine(seed))
    if method == "soons":
        measured = replace(measured, chain="YXZ")
    before = solve(measured, method)
    rng = np.random.default_rng(seed)
    names = {line.setup: f"setup {number}" for number, line in enumerate(measured.lines)}
    shuffled = [
        replace(measured.lines[i], setup=names[measured.lines[i].setup])
        for i in rng.permutation(len(measured.lines))
    ]
    agree(before, solve(replace(measured, lines=tuple(shuffled)), method))


@pytest.mark.parametrize("method", METHODS)
@FEW
@given(seed=seeds)
def test_a_line_told_from_its_other_end_is_the_same_line(method, seed):
    """Reversing the stops of a pass and calling it backward changes nothing."""
    measured = measure(*machine(seed))
    if method == "soons":
        measured = replace(measured, chain="YXZ")
    turned = []
    for line in measured.lines:
        other = "forward" if line.line.direction == "backward" else "backward"
        turned.append(
            replace(
                line,
                line=replace(line.line, direction=other),
                target=line.target[::-1].copy(),
                displacement=line.displacement[::-1].copy(),
                standard_uncertainty=line.standard_uncertainty[::-1].copy(),
                environment=line.environment[::-1].copy(),
            )
        )
    agree(solve(measured, method), solve(replace(measured, lines=tuple(turned)), method))


@pytest.mark.parametrize("method", METHODS)
@FEW
@given(seed=seeds, scale=st.sampled_from([1e-3, 25.4e-3, 39.37, 1000.0]))
def test_another_unit_of_length_scales_lengths_and_leaves_angles(method, seed, scale):
    measured = measure(*machine(seed))
    if method == "soons":
        measured = replace(measured, chain="YXZ")
    volume = measured.volume
    larger = Measurement(
        Volume(
            tuple(scale * v for v in volume.origin),
            tuple(scale * v for v in volume.step),
            volume.blocks,
        ),
        tuple(
            replace(
                line,
                target=scale * line.target,
                displacement=scale * line.displacement,
                standard_uncertainty=scale * line.standard_uncertainty,
            )
            for line in measured.lines
        ),
        measured.chain,
    )
    one, other = solve(measured, method), solve(larger, method)
    for name, curve in one.curves.items():
        factor = 1.0 if name in ROTATIONS else scale
        size = 1e-10 if name in ROTATIONS else 1e-12 * scale
        assert other.curves[name] == pytest.approx(factor * curve, abs=size, nan_ok=True), name
    for figure in one.figures:
        if figure.unit == "rad":
            assert other.figure(figure.name).value == pytest.approx(
                figure.value, abs=1e-10, nan_ok=True
            )


@pytest.mark.parametrize("method", METHODS)
@FEW
@given(seed=seeds, shift=st.tuples(*[st.integers(-3000, 3000)] * 3), zero=st.floats(-0.5, 0.5))
def test_the_machines_zero_and_the_lasers_zero_do_not_matter(method, seed, shift, zero):
    measured = measure(*machine(seed))
    if method == "soons":
        measured = replace(measured, chain="YXZ")
    away = np.array(shift) * 1e-3
    volume = measured.volume
    moved = Measurement(
        replace(volume, origin=tuple(float(v) for v in np.asarray(volume.origin) + away)),
        tuple(
            replace(line, target=line.target + away, displacement=line.displacement + zero)
            for line in measured.lines
        ),
        measured.chain,
    )
    agree(solve(measured, method), solve(moved, method), 1e-11)


@pytest.mark.parametrize("method", ROBUST)
@FEW
@given(seed=seeds, theta=st.tuples(*[st.floats(-3e-7, 3e-7)] * 3))
def test_a_machine_that_is_turned_as_a_whole_gives_the_same_curves(method, seed, theta):
    """A rigid rotation θ adds θ × (q ê_i) to the curves of axis i: no error of the machine."""
    volume, cell = machine(seed, noise=0.0, tilt=0.0, size=1e-7)
    nodes = volume.all_nodes
    turned = {}
    for axis, letter in enumerate(AXES):
        values = cell.errors.values[axis]
        slopes = np.cross(theta, np.eye(3)[axis])
        for error, name in enumerate(AXES):
            turned[f"E_{name}{letter}"] = values[:, error] + slopes[error] * nodes[axis]
    other = replace(cell, errors=ErrorCurves.from_curves(nodes, turned))
    one = cell.truth(volume)
    for name, curve in in_result_frame(nodes, turned).items():
        assert curve == pytest.approx(one[name], abs=1e-18)
    # The second order: products of slopes (1e-7 m over 30 mm) and errors, some of them.
    before, after = solve(measure(volume, cell), method), solve(measure(volume, other), method)
    for name in TRANSLATIONS:
        assert after.curves[name] == pytest.approx(before.curves[name], abs=1e-10), name
        assert before.curves[name] == pytest.approx(one[name], abs=1e-10), name


@FEW
@given(seed=seeds, axis=st.integers(0, 2))
def test_a_mirror_image_of_the_machine_has_mirrored_errors(seed, axis):
    """Seen in a mirror across an axis: its positions run the other way, and so do its errors.

    Diagonals change their names (and, where all signs would change, their direction: the reading
    changes its sign then). Squareness of the two planes with that axis changes its sign.
    """
    volume, cell = machine(seed)
    measured = measure(volume, cell)
    blocks, step = volume.blocks, np.asarray(volume.step)
    far = np.asarray(volume.origin)[axis] + blocks * step[axis]
    new_origin = list(volume.origin)
    new_origin[axis] = -far
    lines = []
    for line in measured.lines:
        name, sign = line.line.name, 1.0
        if len(name) == 3:
            letters = list(name)
            letters[axis] = "n" if letters[axis] == "p" else "p"
            name = "".join(letters)
            if name.count("n") >= 2:
                name = "".join("p" if letter == "n" else "n" for letter in name)
                sign = -1.0
        elif "xyz".index(name) == axis:
            sign = -1.0
        order, direction = line.line.order, line.line.direction
        if sign < 0:
            order = order[::-1]
            direction = "forward" if direction == "backward" else "backward"
        target = line.target.copy()
        target[:, axis] *= -1.0
        if len(name) == 1 and "xyz".index(name) != axis:
            # A linear line stands at the box's corner, which is the other one now: no matter here.
            target[:, axis] = new_origin[axis]
        made = replace(line.line, name=name, order=order, direction=direction)
        lines.append(
            replace(
                line,
                line=made,
                setup=f"mirrored {line.setup}",
                target=target,
                displacement=sign * line.displacement,
            )
        )
    mirrored = Measurement(
        Volume(tuple(float(v) for v in new_origin), volume.step, blocks),
        tuple(lines),
        measured.chain,
    )
    # Rotations that the machine may have are zero at the first node, which a mirror makes the last.
    one, other = (solve(replace(run, plausible=NOTHING)) for run in (measured, mirrored))
    for name, (_, pair) in SQUARENESS_SLOPES.items():
        letters = {letter for curve in pair for letter in curve[2:]}
        sign = -1.0 if AXES[axis] in letters else 1.0
        assert other.figure(name).value == pytest.approx(
            sign * one.figure(name).value, abs=1e-10
        ), name
    for name in ("E_XX", "E_YY", "E_ZZ"):
        curve = one.curves[name]
        if AXES.index(name[3]) == axis:
            curve = -(curve[::-1] - curve[-1])
        assert other.curves[name] == pytest.approx(curve, abs=1e-11), name
    for name in TRANSLATIONS:
        if name[2] != name[3]:
            figure = f"straightness {name}"
            assert other.figure(figure).value == pytest.approx(
                one.figure(figure).value, abs=1e-11
            ), name


@pytest.mark.parametrize("method", METHODS)
@FEW
@given(seed=seeds)
def test_repeats_that_are_told_twice_halve_the_variance_and_nothing_else(method, seed):
    measured = replace(measure(*machine(seed), repeats=1), plausible=NOTHING)
    if method == "soons":
        measured = replace(measured, chain="YXZ")
    again = tuple(
        replace(line, line=replace(line.line, repeat=1), line_index=line.line_index + 1000)
        for line in measured.lines
    )
    twice = replace(measured, lines=measured.lines + again)
    one, other = solve(measured, method), solve(twice, method)
    for name, curve in one.curves.items():
        size = 1e-10 if name in ROTATIONS else 1e-12
        assert other.curves[name] == pytest.approx(curve, abs=size, nan_ok=True)
    if method in ("conventional", "setup_robust", "alternative"):
        for name, own in one.standard_uncertainty.items():
            assert other.standard_uncertainty[name] == pytest.approx(
                own / np.sqrt(2.0), rel=1e-9, nan_ok=True
            )


@FEW
@given(seed=seeds)
def test_part_of_the_repeats_agrees_with_all_within_what_noise_explains(seed):
    measured = measure(*machine(seed), repeats=3)
    part = replace(measured, lines=tuple(line for line in measured.lines if line.line.repeat == 0))
    whole, less = solve(measured), solve(part)
    for name in TRANSLATIONS:
        # An efficient estimate's difference to one of less data has the difference of variances.
        variance = less.standard_uncertainty[name] ** 2 - whole.standard_uncertainty[name] ** 2
        assert np.all(variance >= -1e-24)
        away = np.abs(less.curves[name] - whole.curves[name])
        assert np.all(away <= 6.0 * np.sqrt(np.maximum(variance, 0.0)) + 1e-12), name


@FEW
@given(seed=seeds, chain=st.sampled_from(CHAINS), line=st.sampled_from(BODY_DIAGONALS))
def test_what_the_first_order_leaves_out_falls_to_a_quarter_when_all_is_halved(seed, chain, line):
    rng = np.random.default_rng(seed)
    nodes = [np.linspace(0.0, 0.3, 4)] * 3
    curves = {name: 1e-5 * rng.standard_normal(4) for name in TRANSLATIONS}
    curves.update({name: 1e-4 * rng.standard_normal(4) for name in ROTATIONS})
    direction = beam_direction(line, np.array([0.1, 0.07, 0.05]))
    across = np.cross(direction, rng.standard_normal(3))
    tilt = 3e-4 * across / np.linalg.norm(across)
    places = rng.uniform(0.0, 0.3, (30, 3))
    origin = np.array([-0.2, -0.1, 0.3])

    def left(share):
        errors = ErrorCurves.from_curves(nodes, {n: share * c for n, c in curves.items()})
        turned = direction + share * tilt
        turned = turned / np.linalg.norm(turned)
        exact = reading(places, Alignment(turned, turned, origin), errors, chain)
        linear = reading_first_order(places, direction, share * tilt, origin, errors, chain)
        difference = exact - linear
        return difference - difference[0]

    whole, half = np.linalg.norm(left(1.0)), np.linalg.norm(left(0.5))
    assert 3.9 < whole / half < 4.1
