"""Squareness from diagonals: exact on simulated machines in sign and size, and its refusals."""

from dataclasses import replace

import numpy as np
import pytest
from refused import a_fault, refused

from stepdiag_ros.metrology.forward import SQUARENESS_SLOPES, ErrorCurves, tool_point
from stepdiag_ros.metrology.geometry import (
    BODY_DIAGONALS,
    CHAINS,
    FACE_DIAGONALS,
    ROTATIONS,
    TRANSLATIONS,
    line_signs,
)
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.metrology.plausible import NOTHING, PLAUSIBLE_SCALE, PLAUSIBLE_SHIFT, Plausible
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.standards.diagonal_squareness import (
    PAIRS,
    DiagonalLength,
    LinearError,
    LinearLine,
    check_ends,
    from_body,
    from_face,
    lengths_of,
    linear_errors_of,
    squareness_error_of_shift,
    squareness_from,
    squareness_of,
)

LOW, HIGH = np.array([0.1, -0.2, 0.0]), np.array([0.9, 0.4, 0.5])
TRAVEL = HIGH - LOW


def ends(name):
    signs = line_signs(name)
    start = np.where(signs < 0, HIGH, LOW)
    return start, np.where(signs < 0, LOW, HIGH)


def true_length(name, errors, chain):
    start, finish = ends(name)
    actual, _ = tool_point(np.array([start, finish]), errors, chain)
    if "0" in name:
        # The axis that stands is at its first node, and the length is that in space all the same.
        start, finish = (np.where(line_signs(name) == 0, LOW, place) for place in (start, finish))
        actual, _ = tool_point(np.array([start, finish]), errors, chain)
    nominal = np.linalg.norm(finish - start)
    return DiagonalLength(
        name,
        tuple(start),
        tuple(finish),
        float(np.linalg.norm(actual[1] - actual[0]) - nominal),
        same_approach=True,
    )


def machine(slopes, linear=(0.0, 0.0, 0.0)):
    """Make a machine of straight axes: slopes of single curves, and positioning errors, m/m."""
    nodes = [np.array([low, high]) for low, high in zip(LOW, HIGH, strict=True)]
    rates = dict(slopes)
    rates.update({f"E_{axis}{axis}": rate for axis, rate in zip("XYZ", linear, strict=True)})
    curves = {
        name: np.array([0.0, rate * TRAVEL["XYZ".index(name[3])]]) for name, rate in rates.items()
    }
    return ErrorCurves.from_curves(nodes, curves)


def true_squareness(slopes, name):
    factor, pair = SQUARENESS_SLOPES[name]
    return factor * sum(slopes.get(curve, 0.0) for curve in pair)


LINEAR_ERRORS = (80e-6, -150e-6, 30e-6)


@pytest.mark.parametrize("chain", CHAINS)
@pytest.mark.parametrize("curve", ["E_XY", "E_YX", "E_XZ", "E_ZX", "E_YZ", "E_ZY"])
def test_sign_and_size_of_every_slope_beside_linear_errors(curve, chain):
    slopes = {curve: 40e-6}
    errors = machine(slopes, LINEAR_ERRORS)
    faces = [true_length(name, errors, chain) for name in FACE_DIAGONALS]
    bodies = [true_length(name, errors, chain) for name in BODY_DIAGONALS]
    found = squareness_from(faces + bodies)
    assert len(found.values) == 6
    for one in found.values:
        # The rest is of second order: 4e-5 times 1.5e-4.
        assert one.value == pytest.approx(true_squareness(slopes, one.name), abs=1.5e-8), one


def test_theta_is_positive_where_the_angle_is_smaller_than_90_degrees():
    """The angle of the drawing, by its cosine, from the tool points themselves."""
    slopes = {"E_XY": 30e-6, "E_YX": 10e-6, "E_XZ": -20e-6, "E_ZY": 5e-6}
    errors = machine(slopes)
    found = squareness_from([true_length(name, errors, "XYZ") for name in FACE_DIAGONALS])
    for one in found.values:
        i, j = PAIRS[one.name]
        corner, first, second = LOW.copy(), LOW.copy(), LOW.copy()
        first[i], second[j] = HIGH[i], HIGH[j]
        points, _ = tool_point(np.array([corner, first, second]), errors, "XYZ")
        a, b = points[1] - points[0], points[2] - points[0]
        cosine = a @ b / np.linalg.norm(a) / np.linalg.norm(b)
        assert one.theta == pytest.approx(cosine, abs=1e-9)


def test_the_formula_of_the_document():
    one = DiagonalLength("pp0", (0, 0, 0), (0.4, 0.3, 0), 5e-6, 3e-7)
    other = DiagonalLength("np0", (0.4, 0, 0), (0, 0.3, 0), -1e-6, 4e-7)
    found = from_face(one, other, plausible=NOTHING)
    assert found.theta == pytest.approx(0.5 * 6e-6 / (2 * 0.4 * 0.3))
    assert found.standard_uncertainty == pytest.approx(0.5 * 5e-7 / (2 * 0.4 * 0.3))
    assert found.value == -found.theta


def test_equal_axes_give_the_simpler_formula():
    side = 1.0
    one = DiagonalLength("pp0", (0, 0, 0), (side, side, 0), 20e-6)
    other = DiagonalLength("np0", (side, 0, 0), (0, side, 0), 0.0)
    assert from_face(one, other).theta == pytest.approx(20e-6 / np.sqrt(2) / side)


def bodies_of(slopes, linear=LINEAR_ERRORS, spread=1e-7):
    errors = machine(slopes, linear)
    lengths = [true_length(name, errors, "YXZ") for name in BODY_DIAGONALS]
    return [replace(one, standard_uncertainty=spread) for one in lengths]


def linear_tests(linear=LINEAR_ERRORS, spread=1e-7, corners=None):
    """Return linear tests from these corners of X, Y, Z; None: nobody knows where they ran."""
    found = {}
    for number, (axis, rate) in enumerate(zip("XYZ", linear, strict=True)):
        way = TRAVEL * (np.arange(3) == number)
        lines = ()
        if corners is not None:
            start = np.asarray(corners[number], dtype=float)
            lines = (LinearLine(start, start + way),)
        found[axis] = LinearError(float(rate * TRAVEL[number]), spread, lines)
    return found


def test_four_lengths_leave_nothing_to_check_and_linear_tests_leave_one():
    slopes = {"E_XY": 30e-6, "E_XZ": -20e-6}
    alone = from_body(bodies_of(slopes))
    assert np.isnan(alone.closure)
    mean = np.asarray(LINEAR_ERRORS) @ TRAVEL**2 / np.linalg.norm(TRAVEL)
    assert alone.mean_length_error == pytest.approx(mean, abs=2e-8)
    together = from_body(bodies_of(slopes), linear_tests())
    assert abs(together.closure) < 2e-8
    # Diagonals that a shift of the laser's scale between the two sessions has lengthened.
    shifted = [replace(one, error=one.error + 2e-6) for one in bodies_of(slopes)]
    assert from_body(shifted, linear_tests()).closure == pytest.approx(2e-6, abs=2e-8)
    for one, other in zip(alone.values, together.values, strict=True):
        assert one.theta == pytest.approx(other.theta, abs=1e-12)


def test_three_diagonals_are_enough_with_linear_tests():
    slopes = {"E_XY": 30e-6, "E_XZ": -20e-6, "E_ZY": 10e-6}
    found = from_body(bodies_of(slopes)[1:], linear_tests())
    for one in found.values:
        assert one.value == pytest.approx(true_squareness(slopes, one.name), abs=5e-8)
    assert np.isnan(found.closure)
    with refused(Refusal, "too_few", aspect="body diagonals"):
        from_body(bodies_of(slopes)[1:])


@pytest.mark.parametrize(("draws", "near"), [(200, 0.22), (2000, 0.07)], ids=["few", "many"])
def test_the_uncertainty_of_body_diagonals_is_that_of_simulated_noise(draws, near):
    rng = np.random.default_rng(2)
    clean = bodies_of({"E_XY": 30e-6}, spread=2e-7)
    linear = linear_tests(spread=3e-7, corners=[LOW] * 3)
    thetas = []
    for _ in range(draws):
        noisy = [replace(one, error=one.error + 2e-7 * rng.standard_normal()) for one in clean]
        axes = {
            axis: one._replace(error=one.error + 3e-7 * rng.standard_normal())
            for axis, one in linear.items()
        }
        found = from_body(noisy, axes, plausible=NOTHING)
        thetas.append([*(one.theta for one in found.values), found.closure])
    expected = [*(one.standard_uncertainty for one in found.values), found.closure_uncertainty]
    np.testing.assert_allclose(np.std(thetas, axis=0), expected, rtol=near)


def test_an_unknown_uncertainty_stays_unknown():
    lengths = [replace(one, standard_uncertainty=np.nan) for one in bodies_of({"E_XY": 30e-6})]
    found = from_body(lengths)
    assert found.values[0].value == pytest.approx(-30e-6, abs=2e-8)
    assert all(np.isnan(one.standard_uncertainty) for one in found.values)


@pytest.mark.parametrize("chain", CHAINS)
def test_rotations_that_no_length_tells_are_in_the_uncertainty(chain):
    # Machines whose axes turn by 10 µrad at the end, and are straight and square otherwise.
    rng = np.random.default_rng(4)
    names = [f"E_{turn}{axis}" for axis in "XYZ" for turn in "ABC"]
    nodes = [np.array([low, high]) for low, high in zip(LOW, HIGH, strict=True)]
    linear = linear_tests((0.0, 0.0, 0.0), 0.0, corners=np.zeros((3, 3)))
    known = Plausible(rotation=10e-6, shift=0.0, scale=0.0)
    thetas = []
    for _ in range(400):
        turns = {name: np.array([0.0, 10e-6 * rng.standard_normal()]) for name in names}
        errors = ErrorCurves.from_curves(nodes, turns)
        # Levers count from the corner where the other axes stand.
        lengths = {
            name: turned_length(name, errors, chain) for name in (*BODY_DIAGONALS, *FACE_DIAGONALS)
        }
        body = from_body([lengths[name] for name in BODY_DIAGONALS], linear, chain, known)
        faces = [
            from_face(lengths[one], lengths[other], chain, known)
            for one, other in zip(FACE_DIAGONALS[::2], FACE_DIAGONALS[1::2], strict=True)
        ]
        every = [*body.values, *faces]
        thetas.append([*(one.theta for one in every), body.closure])
    expected = [*(one.standard_uncertainty for one in every), body.closure_uncertainty]
    np.testing.assert_allclose(np.std(thetas, axis=0), expected, rtol=0.12, atol=2e-10)
    blind = from_body([lengths[name] for name in BODY_DIAGONALS], linear, "", known)
    for one, worst in zip(body.values, blind.values, strict=True):
        assert worst.standard_uncertainty >= one.standard_uncertainty * (1.0 - 1e-12)


@pytest.mark.parametrize("chain", CHAINS)
def test_a_linear_test_whose_place_is_unknown_counts_as_that_of_the_worst_edge(chain):
    far, lengths = TRAVEL * (1.0 - np.eye(3)), bodies_of({})
    lengths = [
        replace(one, start=tuple(one.start - LOW), finish=tuple(one.finish - LOW))
        for one in lengths
    ]

    def spreads(corners):
        found = from_body(lengths[:3], linear_tests(corners=corners), chain)
        return np.array([one.standard_uncertainty for one in found.values])

    unknown, near = spreads(None), spreads(np.zeros((3, 3)))
    assert np.all(unknown >= np.maximum(near, spreads(far)) * (1.0 - 1e-12))
    assert np.max(unknown / near) > 1.2


@pytest.mark.parametrize("chain", ["ZXY", "YXZ"])
@pytest.mark.parametrize("machines", [60, 400], ids=["few", "many"])
def test_squareness_from_three_diagonals_lies_inside_u_where_linear_lines_run_at_far_edges(
    chain, machines
):
    # Without what rotations do at the offset of the lines, 73 % and 84 % of C0Y lay inside.
    from cells_for_tests import make_cell

    side, edge = 0.5, np.linspace(0.0, 0.5, 3)
    far = [
        {"kind": "linear", "names": [axis], "offset_m": [side * (one != axis) for one in "xyz"]}
        for axis in "xyz"
    ]
    plan = Plan.from_mapping(
        {
            "step_m": [side / 2] * 3,
            "blocks": 2,
            "directions": ["forward", "backward"],
            "overrun_m": 0.002,
            "feed_m_per_s": 0.05,
            "lines": [{"kind": "diagonal", "names": ["ppp", "npp", "pnp"]}, *far],
        },
        "lines at far edges",
    )
    inside = []
    for seed in range(machines):
        rng, scales = np.random.default_rng(seed), {}
        curves = {name: 1e-6 * np.r_[0.0, rng.normal(size=2)] for name in TRANSLATIONS}
        turns = {name: 10e-6 * np.r_[0.0, 0.5, 1.0] * rng.normal() for name in ROTATIONS}
        errors = ErrorCurves.from_curves([edge] * 3, {**curves, **turns})
        cell = replace(make_cell(seed, chain, tilt=0.0), errors=errors)
        run, common = simulate(plan, cell, seed), PLAUSIBLE_SCALE * rng.normal()
        lines = []
        for line in run.lines:
            own = scales.setdefault(line.setup, PLAUSIBLE_SHIFT * rng.normal())
            read = line.displacement * (1.0 + common + own) + 1e-7 * rng.normal()
            lines.append(replace(line, displacement=read))
        for one in squareness_of(replace(run, lines=tuple(lines))).values:
            true = sum(curves[pair][-1] for pair in SQUARENESS_SLOPES[one.name][1]) / side
            error = one.theta - true
            inside.append(abs(error) < 1.96 * one.standard_uncertainty)
    shares = np.mean(np.reshape(inside, (machines, 3)), axis=0)
    assert np.all(shares > (0.88 if machines < 100 else 0.925)), shares


def turned_length(name, errors, chain):
    """Return a length on a machine whose zero is the low corner, so that levers begin there."""
    nodes = [axis - axis[0] for axis in errors.nodes]
    shifted = ErrorCurves(tuple(nodes), errors.values)
    start, finish = (np.where(line_signs(name) == 0, 0.0, place - LOW) for place in ends(name))
    actual, _ = tool_point(np.array([start, finish]), shifted, chain)
    gained = np.linalg.norm(actual[1] - actual[0]) - np.linalg.norm(finish - start)
    return DiagonalLength(name, tuple(start), tuple(finish), float(gained), 0.0, True)


def test_a_shift_of_the_laser_is_that_of_the_document():
    # RL's graph: a scale that shifts between the diagonals of a square, 1 µrad for 1 ppm.
    one = DiagonalLength("pp0", (0, 0, 0), (1.0, 1.0, 0), 0.0, 0.0)
    other = DiagonalLength("np0", (1.0, 0, 0), (0, 1.0, 0), 0.0, 0.0)
    known = Plausible(rotation=0.0, shift=1e-6, scale=5e-6)
    found = from_face(one, other, "XYZ", known).standard_uncertainty
    assert found == pytest.approx(np.sqrt(2.0) * squareness_error_of_shift(1e-6, 1.0))


def plan_of(kind, names, overrun, **more):
    lines = [{"kind": kind, "names": list(names), **more}]
    lines.append({"kind": "linear", "names": ["x", "y", "z"]})
    return Plan.from_mapping(
        {
            "step_m": [0.012, 0.009, 0.010],
            "blocks": 4,
            "repeats": 2,
            "directions": ["forward", "backward"],
            "overrun_m": overrun,
            "feed_m_per_s": 0.05,
            "lines": lines,
        },
        "test plan",
    )


@pytest.mark.parametrize(
    ("kind", "names", "overrun"),
    [
        ("diagonal", (*BODY_DIAGONALS, *FACE_DIAGONALS), 0.001),
        ("diagonal", FACE_DIAGONALS[:2], 0.001),
        ("step_diagonal", BODY_DIAGONALS, 0.0),
    ],
)
def test_a_measurement_tells_the_squareness_of_its_machine(kind, names, overrun):
    from cells_for_tests import make_cell

    plan = plan_of(kind, names, overrun)
    cell = make_cell(noise=0.0, tilt=0.0, mirror=200e-6 if kind == "step_diagonal" else 0.0)
    measurement = simulate(plan, cell)
    result = squareness_of(measurement)
    truth = cell.truth(plan.volume)
    travel = np.asarray(plan.volume.step) * plan.volume.blocks
    assert result.values
    for one in result.values:
        factor, pair = SQUARENESS_SLOPES[one.name]
        true = factor * sum(truth[curve][-1] / travel["XYZ".index(curve[3])] for curve in pair)
        # A mirror tilted by 0.2 mrad is a second-order error of 2e-8 of the length.
        assert one.value == pytest.approx(true, abs=1e-7 if kind == "step_diagonal" else 5e-9)
    warned = [remark for remark in result.remarks if "approached in the same" in remark]
    assert len(warned) == (4 if kind == "step_diagonal" else 0)


def test_lengths_and_linear_errors_come_from_both_directions():
    from cells_for_tests import make_cell

    plan = plan_of("diagonal", ["ppp", "np0"], 0.001)
    measurement = simulate(plan, make_cell(noise=0.2e-6, tilt=0.0))
    first, second = lengths_of(measurement)
    assert first.start == (0.0, 0.0, 0.0)
    assert second.start == pytest.approx((0.048, 0.0, 0.0))
    assert second.finish == pytest.approx((0.0, 0.036, 0.0))
    # Four passes with two ends each: 0.2 µm · √(2/4), or more if the passes scatter more.
    assert 0.14e-6 * 0.999 < first.standard_uncertainty < 0.5e-6
    lines = [line for line in measurement.lines if line.line.name == "y"]
    direct = np.mean([abs(line.displacement[-1] - line.displacement[0]) - 0.036 for line in lines])
    assert linear_errors_of(measurement)["Y"][0] == pytest.approx(direct, abs=1e-15)


PAIR = (
    DiagonalLength("pp0", (0, 0, 0), (0.4, 0.3, 0), 0.0, same_approach=True),
    DiagonalLength("np0", (0.4, 0, 0), (0, 0.3, 0), 0.0, same_approach=True),
)


def test_the_correct_start_and_finish_pass_in_silence():
    assert check_ends(PAIR) == ()


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        (
            {"start": (0.39, 0, 0)},
            a_fault("mismatch", "np0", "390.000", "0.000", "pp0", aspect="ends"),
        ),
        ({"finish": (0, 0.31, 0)}, a_fault("mismatch", "np0", aspect="ends")),
        (
            {"start": (0.4, 0, 0.1), "finish": (0, 0.3, 0.1)},
            a_fault("mismatch", "np0", aspect="ends"),
        ),
        ({"start": (0, 0, 0), "finish": (0.4, 0.3, 0)}, a_fault("mismatch", aspect="name")),
        ({"same_approach": False}, a_fault("mismatch", aspect="approach")),
    ],
)
def test_an_incorrect_start_or_finish_is_refused_in_words(changed, message):
    wrong = (PAIR[0], replace(PAIR[1], **changed))
    with refused(Refusal, message):
        from_face(*wrong)
    with refused(Refusal, "too_few", aspect="diagonals"):
        squareness_from(wrong)


def test_an_unknown_approach_is_a_warning():
    found = squareness_from((PAIR[0], replace(PAIR[1], same_approach=None)))
    assert len(found.values) == 1
    assert "np0: it is not known that both ends were approached" in found.remarks[0]


def test_a_diagonal_alone_says_nothing():
    with refused(Refusal, "too_few", "pp0", "np0", aspect="diagonals"):
        squareness_from(PAIR[:1])
    with refused(Refusal, "too_few", aspect="diagonals"):
        squareness_from(())
    with refused(Refusal, "mismatch", aspect="face"):
        from_face(PAIR[1], PAIR[0])


def test_the_sensitivity_is_the_effect_of_a_shifted_reading():
    for ratio in (0.25, 1.0, 1.7, 5.0):
        x, y = 0.3 * ratio, 0.3
        length = np.hypot(x, y)
        one = DiagonalLength("pp0", (0, 0, 0), (x, y, 0), 5e-6 * length)
        other = DiagonalLength("np0", (x, 0, 0), (0, y, 0), 0.0)
        expected = squareness_error_of_shift(5e-6, ratio)
        assert from_face(one, other).theta == pytest.approx(float(expected))
    ratios = np.linspace(0.2, 5, 49)
    assert ratios[np.argmin(squareness_error_of_shift(1e-6, ratios))] == pytest.approx(1.0)
    arc_seconds = float(squareness_error_of_shift(5e-6, 1.0)) * 180 * 3600 / np.pi
    assert arc_seconds == pytest.approx(1.03, abs=0.005)
    with refused(Refusal, "out_of_range", "0"):
        squareness_error_of_shift(1e-6, np.array([1.0, 0.0]))
