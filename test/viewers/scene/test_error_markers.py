"""The picture of a result: arrows are error vectors of the forward model, words are true."""

import re
from dataclasses import replace

import numpy as np
import pytest

from stepdiag_ros.configuration import load_plan
from stepdiag_ros.metrology.forward import (
    SQUARENESS_SLOPES,
    Alignment,
    ErrorCurves,
    reading,
    tool_point,
)
from stepdiag_ros.metrology.geometry import AXES, CURVES, ROTATIONS, TRANSLATIONS
from stepdiag_ros.metrology.plan import Volume
from stepdiag_ros.metrology.solvers.result import VolumetricErrors
from stepdiag_ros.metrology.standards.volumetric import of_result
from stepdiag_ros.viewers.scene.error_map import error_vectors, extremes
from stepdiag_ros.viewers.scene.error_markers import (
    LARGEST_SHARE,
    Options,
    chosen_results,
    markers,
    picture,
)
from stepdiag_ros.viewers.scene.shapes import Kind, ramp, round_below, spread

VOLUME = Volume((-0.1, 0.02, 0.3), (0.02, 0.01, 0.015), 10)
PLAN = replace(load_plan("demo")[0], volume=VOLUME)
NODES = VOLUME.all_nodes
WAYS = [nodes - nodes[0] for nodes in NODES]
CHAIN = "YXZ"


def result_of(curves, method="least_squares", spread_of=1e-7, **more):
    return VolumetricErrors(
        method=method,
        nodes=NODES,
        curves=curves,
        standard_uncertainty={name: np.full(11, spread_of) for name in curves},
        figures=(),
        lines=7,
        chi_squared=np.nan,
        degrees_of_freedom=0,
        **more,
    )


def curves_of(seed, names=TRANSLATIONS):
    rng = np.random.default_rng(seed)
    made = {}
    for name in names:
        size = 2e-5 if name in ROTATIONS else 3e-6
        steps = size * rng.standard_normal(11)
        made[name] = np.cumsum(steps) - steps[0]
    return made


def arrows(shapes):
    """Return the drawn arrows: starts and ways."""
    found = [shape.points for shape in shapes if shape.kind is Kind.ARROW]
    points = np.array(found).reshape(-1, 2, 3)
    return points[:, 0], points[:, 1] - points[:, 0]


def text_of(shapes, group="text"):
    (text,) = (shape.text for shape in shapes if shape.group.endswith(f"/{group}") and shape.text)
    return text


def scale_in(text):
    return float(re.search(r"drawn ([\d ]+) times as long", text)[1].replace(" ", ""))


@pytest.mark.parametrize("names", [TRANSLATIONS, CURVES])
def test_arrows_are_what_beams_along_the_axes_read(names):
    """Beams along X, Y, Z through the tool, before and after: the arrows' components."""
    curves = curves_of(1, names)
    shapes = markers(result_of(curves), PLAN, Options(chain=CHAIN))
    starts, ways = arrows(shapes)
    scale = scale_in(text_of(shapes))
    assert len(starts) > 100
    errors = ErrorCurves.from_curves(WAYS, curves)
    corner = np.array([nodes[0] for nodes in NODES])
    for axis in range(3):
        beam = np.eye(3)[axis]
        for start, way in zip(starts[::7], ways[::7], strict=True):
            place = start - corner
            # The mirror may tilt: the beam meets it where it would be without errors.
            alignment = Alignment(beam, beam, place - 0.2 * beam)
            lengthened = reading(place[None], alignment, errors, CHAIN)[0] - 0.2
            assert way[axis] / scale == pytest.approx(lengthened, abs=1e-8)


@pytest.mark.parametrize("name", SQUARENESS_SLOPES)
def test_a_positive_squareness_turns_the_drawn_axis_right_handed(name):
    """C0Y > 0: the angle from +X to +Y is larger than 90°; B0Z and A0Z likewise by their axes."""
    sign, (moving, _) = SQUARENESS_SLOPES[name]
    error, axis = (AXES.index(letter) for letter in moving[2:])
    curves = {one: np.zeros(11) for one in TRANSLATIONS}
    curves[moving] = sign * 1e-4 * WAYS[axis]
    starts, ways = arrows(markers(result_of(curves), PLAN))
    turn = np.zeros(3)
    turn["ABC".index(name[0])] = 1.0
    expected = np.cross(turn, np.eye(3)[axis])
    assert np.all(ways @ expected > 0.0) and expected[error] == sign
    # It grows along the axis that is turned, and only along that.
    np.testing.assert_allclose(
        ways @ expected / (starts - [nodes[0] for nodes in NODES])[:, axis],
        (ways @ expected)[0] / (starts[0] - [nodes[0] for nodes in NODES])[axis],
        rtol=1e-9,
    )


def test_the_deformed_grid_goes_through_the_tips_of_the_arrows():
    shapes = markers(result_of(curves_of(2)), PLAN)
    (grid,) = (shape for shape in shapes if shape.group.endswith("/grid"))
    starts, ways = arrows(shapes)
    low, high = (np.array([nodes[end] for nodes in NODES]) for end in (0, -1))
    on_face = np.any(np.isclose(starts, low) | np.isclose(starts, high), axis=1)
    assert 50 < np.count_nonzero(on_face) < len(starts)
    for tip in (starts + ways)[on_face]:
        assert np.min(np.linalg.norm(grid.points - tip, axis=1)) < 1e-12
    assert len(grid.colours) == len(grid.points)


@pytest.mark.parametrize("seed", range(3))
def test_the_scale_is_round_and_the_longest_arrow_well_seen(seed):
    curves = {name: curve * 10.0**seed for name, curve in curves_of(seed).items()}
    result = result_of(curves)
    shapes = markers(result, PLAN)
    scale = scale_in(text_of(shapes))
    assert float(f"{scale:.0e}") == scale and f"{scale:.0e}"[0] in "125"
    drawn = scale * of_result(result).value / 0.1
    assert LARGEST_SHARE / 2.5 <= drawn <= LARGEST_SHARE
    _, ways = arrows(shapes)
    assert np.max(np.linalg.norm(ways, axis=1)) <= LARGEST_SHARE * 0.1
    _, asked = arrows(markers(result, PLAN, Options(exaggeration=2 * scale)))
    np.testing.assert_allclose(asked, 2.0 * ways, atol=1e-12)


def test_the_scale_bar_is_as_long_as_it_says():
    shapes = markers(result_of(curves_of(4)), PLAN)
    (bar,) = (s for s in shapes if s.group.endswith("/scale") and s.kind is Kind.PATH)
    length = np.linalg.norm(bar.points[-1] - bar.points[0])
    label = text_of(shapes, "scale")
    assert float(label.split()[0]) * 1e-6 * scale_in(text_of(shapes)) == pytest.approx(length)


def test_the_words_say_how_large_how_sure_and_where():
    curves = curves_of(5)
    found = of_result(result_of(curves))
    text = text_of(markers(result_of(curves), PLAN)).replace("\n", " ")
    assert f"{found.value * 1e6:.0f} µm" in text and "U at most" in text
    # Three of the nine curves end at zero at the first node: six or fewer uncertainties add up.
    bound = float(re.search(r"at most ([\d.]+) µm", text)[1]) * 1e-6 / 1.96
    assert bound == pytest.approx(found.uncertainty_limit, rel=0.05)
    covariance = np.eye(99) * 1e-14
    exact = of_result(result_of(curves, covariance=covariance))
    assert exact.standard_uncertainty < found.uncertainty_limit
    sure = text_of(markers(result_of(curves, covariance=covariance), PLAN)).replace("\n", " ")
    assert "at most" not in sure
    stated = float(re.search(r"U ([\d.]+) µm of the readings", sure)[1]) * 1e-6 / 1.96
    assert stated == pytest.approx(exact.standard_uncertainty, rel=0.05)
    assert (
        ", ".join(
            f"{axis} {where * 1e3:.1f}" for axis, where in zip(AXES, found.position, strict=True)
        )
        in text
    )
    grid = np.stack(np.meshgrid(*NODES, indexing="ij"), axis=-1).reshape(-1, 3)
    sizes = np.linalg.norm(error_vectors(result_of(curves), "", grid), axis=1)
    rms = np.sqrt(np.mean(sizes**2))
    assert f"rms {rms * 1e6:.2f} µm over all nodes" in text
    assert found.value == pytest.approx(np.max(sizes)) and result_of(curves).frame[:20] in text
    unsure = text_of(markers(result_of(curves, spread_of=np.nan), PLAN))
    assert "U unknown" in unsure


@pytest.mark.parametrize("gap", [slice(None), slice(1, None), slice(5, 6)])
@pytest.mark.parametrize("name", ["E_YX", "E_ZZ"])
def test_what_is_not_known_is_not_drawn_but_said(name, gap):
    curves = curves_of(6)
    curves[name][gap] = np.nan
    shapes = markers(result_of(curves), PLAN)
    assert "largest error unknown" in text_of(shapes)
    assert f"unknown: {name}" in text_of(shapes) and "rms" not in text_of(shapes)
    starts, _ = arrows(shapes)
    axis = AXES.index(name[3])
    node = np.rint((starts - VOLUME.origin)[:, axis] / VOLUME.step[axis]).astype(int)
    assert not set(node) & set(np.flatnonzero(np.isnan(curves[name])))
    assert bool(len(starts)) == (gap != slice(None))
    assert all(np.all(np.isfinite(shape.points)) for shape in shapes)


def test_an_end_that_the_frame_makes_zero_is_no_finding():
    curves = curves_of(6)
    curves["E_YX"] = np.array([0.0, *[np.nan] * 9, 0.0])
    starts, _ = arrows(markers(result_of(curves), PLAN))
    assert len(starts) and set(starts[:, 0]) == {NODES[0][0]}


def test_half_known_pieces_of_the_grid_are_not_drawn():
    curves = curves_of(6)
    curves["E_XY"][5] = np.nan
    (grid,) = (s for s in markers(result_of(curves), PLAN) if s.group.endswith("/grid"))
    whole = markers(result_of(curves_of(6)), PLAN)
    (all_of_it,) = (s for s in whole if s.group.endswith("/grid"))
    assert 0 < len(grid.points) < len(all_of_it.points) and len(grid.points) % 2 == 0


def test_a_missing_translation_hides_everything():
    curves = curves_of(6)
    del curves["E_XY"]
    shapes = markers(result_of(curves), PLAN)
    assert {shape.group for shape in shapes} == {"box", "least_squares/text"}
    assert "E_XY" in text_of(shapes)


def test_an_unknown_rotation_counts_where_it_has_a_lever():
    curves = curves_of(7, CURVES)
    curves["E_AZ"][:] = np.nan
    grid = np.stack(np.meshgrid(*NODES, indexing="ij"), axis=-1).reshape(-1, 3)
    # Z is the last axis of the chain: nothing hangs on it. First, X and Y hang on it.
    assert np.all(np.isfinite(error_vectors(result_of(curves), "YXZ", grid)))
    vectors = error_vectors(result_of(curves), "ZXY", grid)
    on_lever = np.any(grid[:, :2] != [NODES[0][0], NODES[1][0]], axis=1)
    assert np.all(np.isnan(vectors[on_lever])) and np.all(np.isfinite(vectors[~on_lever]))
    assert np.all(np.isnan(error_vectors(result_of(curves), "", grid)))
    words = text_of(markers(result_of(curves_of(7, CURVES)), PLAN)).replace("\n", " ")
    assert "order of the machine's axes is not known" in words


def test_rods_turn_as_the_axes_do():
    curves = {name: np.zeros(11) for name in CURVES}
    curves["E_CX"] = np.linspace(0.0, 1e-4, 11)
    shapes = [
        shape
        for shape in markers(result_of(curves, "rigid_body"), PLAN, Options(chain=CHAIN))
        if shape.group.endswith("/angles")
    ]
    rods = [shape.points.reshape(-1, 2, 3) for shape in shapes]
    ways = [rod[:, 1] - rod[:, 0] for rod in rods]
    last = [np.argmax(rod[:, 0, 0]) for rod in rods]  # at the end of the travel of X
    # A positive rotation about Z turns X towards Y and Y towards -X, and leaves Z alone.
    assert ways[0][last[0]][1] > 0.0 and ways[1][last[1]][0] < 0.0
    np.testing.assert_allclose(ways[2][:, :2], 0.0, atol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(np.vstack(ways), axis=1), 0.01, rtol=1e-12)


def test_a_rod_needs_both_rotations_that_tilt_it():
    curves = {name: np.full(11, np.nan) for name in CURVES}
    curves["E_AX"], curves["E_BX"] = (np.linspace(0.0, size, 11) for size in (1e-5, 2e-5))
    shapes = markers(result_of(curves, "rigid_body"), PLAN, Options(chain=CHAIN))
    assert {(s.group, s.number) for s in shapes if s.group.endswith("/angles")} == {
        ("rigid_body/angles", 2)
    }
    assert "times as large" in text_of(shapes)
    everything_unknown = {name: np.full(11, np.nan) for name in CURVES}
    nothing = markers(result_of(everything_unknown), PLAN, Options(chain=CHAIN))
    assert {shape.group for shape in nothing} == {"box", "least_squares/text"}
    assert "times as" not in text_of(nothing)


def test_a_perfect_machine_is_drawn_without_arrows():
    shapes = markers(result_of({name: np.zeros(11) for name in TRANSLATIONS}), PLAN)
    assert "largest error 0" in text_of(shapes) and not len(arrows(shapes)[0])


def test_no_result_is_the_box_alone():
    (box,) = markers(None, PLAN)
    assert box.group == "box" and len(box.points) == 24
    np.testing.assert_allclose(box.points.min(axis=0), [nodes[0] for nodes in NODES])
    np.testing.assert_allclose(box.points.max(axis=0), [nodes[-1] for nodes in NODES])
    assert [shape.group for shape in picture((), PLAN)] == ["box"]


def test_several_results_are_exaggerated_alike_and_do_not_cover_each_other():
    small = result_of({name: curve / 10.0 for name, curve in curves_of(8).items()}, "setup_robust")
    shapes = picture((small, result_of(curves_of(8))), PLAN)
    texts = [shape for shape in shapes if shape.group.endswith("/text")]
    bars = {shape.text for shape in shapes if shape.group.endswith("/scale") and shape.text}
    assert {bar.split(", ")[1] for bar in bars} == {"Setup-robust", "Least squares"}
    assert len({scale_in(text.text) for text in texts}) == 1
    assert len({text.points[0, 2] for text in texts}) == 2
    assert [shape.group for shape in shapes].count("box") == 1
    assert len({(shape.group, shape.number) for shape in shapes}) == len(shapes)


def test_the_preferred_result_is_the_one_to_rely_on():
    results = {name: result_of({}, name) for name in ("rigid_body", "setup_robust", "conventional")}
    assert [one.method for one in chosen_results(results, "preferred")] == ["rigid_body"]
    results["least_squares"] = result_of({}, "least_squares")
    assert [one.method for one in chosen_results(results, "preferred")] == ["least_squares"]
    assert [one.method for one in chosen_results(results, "conventional")] == ["conventional"]
    assert chosen_results(results, "soons") == ()
    assert len(chosen_results(results, "all")) == 4


def test_a_box_of_very_many_nodes_is_looked_at_in_some():
    blocks = 500
    volume = Volume((0.0, 0.0, 0.0), (1e-3, 1e-3, 1e-3), blocks)
    nodes = volume.all_nodes
    curves = dict.fromkeys(TRANSLATIONS, 1e-05 * nodes[0])
    result = replace(
        result_of(curves),
        nodes=nodes,
        standard_uncertainty={name: np.zeros(blocks + 1) for name in curves},
    )
    found = extremes(result, "")
    assert found.every == 9 and found.accuracy.value == pytest.approx(1e-5 * 0.5 * 3 * 3**0.5)
    shapes = markers(result, replace(PLAN, volume=volume))
    assert "every 9. node of an axis" in text_of(shapes)
    assert len(shapes) < 500 and max(len(shape.points) for shape in shapes) < 200_000


def test_the_tool_point_is_left_as_it_is():
    """The exact model, not the first order, is what is drawn."""
    curves = curves_of(9, CURVES)
    errors = ErrorCurves.from_curves(WAYS, curves)
    place = np.array([[0.1, 0.05, 0.06]])
    actual, _ = tool_point(place, errors, CHAIN)
    zero, _ = tool_point(np.zeros((1, 3)), errors, CHAIN)
    drawn = error_vectors(result_of(curves), CHAIN, place + [nodes[0] for nodes in NODES])
    np.testing.assert_allclose(drawn, actual - place - zero, atol=1e-17)


def test_larger_is_brighter_for_every_kind_of_colour_vision():
    colours = ramp(np.linspace(0.0, 1.0, 50))
    linear = np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)
    luminance = linear[:, :3] @ [0.2126, 0.7152, 0.0722]
    assert np.all(np.diff(luminance) > 0.0) and luminance[-1] > 5 * luminance[0]


@pytest.mark.parametrize(
    ("value", "expected"), [(1.0, 1.0), (1.99, 1.0), (5e-6, 5e-6), (9999.0, 5000.0), (0.02, 0.02)]
)
def test_round_numbers(value, expected):
    assert round_below(value) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("count", [2, 3, 7, 11, 12, 13, 14, 38, 1001])
def test_some_of_many_with_both_ends(count):
    chosen = spread(count, 7)
    assert chosen[0] == 0 and chosen[-1] == count - 1 and 2 <= len(chosen) <= 7
    assert np.ptp(np.diff(chosen)) <= 1
