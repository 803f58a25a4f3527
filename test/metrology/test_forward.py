import numpy as np
import pytest
from refused import refused

from stepdiag_ros.metrology.forward import (
    OVER_90_DEGREES,
    SQUARENESS_DEFINITIONS,
    SQUARENESS_SLOPES,
    Alignment,
    ErrorCurves,
    in_result_frame,
    levers,
    perpendiculars,
    reading,
    reading_first_order,
    rotation_matrices,
    tilted,
    tool_point,
)
from stepdiag_ros.metrology.geometry import (
    AXES,
    CHAINS,
    ROTATIONS,
    TRANSLATIONS,
    beam_direction,
    cross,
)
from stepdiag_ros.metrology.refusal import Refusal

NODES = [np.array([0.0, 0.1]), np.array([0.0, 0.2]), np.array([0.0, 0.3])]
ENDS = np.array([[0.1, 0.2, 0.3]])


def constant(**errors):
    """Errors that have their value everywhere."""
    return ErrorCurves.from_curves(NODES, {name: np.full(2, e) for name, e in errors.items()})


def ramp(**errors):
    """Errors that rise from zero at the first node to their value at the last."""
    return ErrorCurves.from_curves(NODES, {n: np.array([0.0, e]) for n, e in errors.items()})


def moved(errors, chain, offset=None):
    point, _ = tool_point(ENDS, errors, chain, offset)
    ideal = ENDS[0] + (0.0 if offset is None else np.asarray(offset))
    return point[0] - ideal


@pytest.mark.parametrize("name", TRANSLATIONS)
@pytest.mark.parametrize("chain", CHAINS)
def test_a_translation_moves_the_tool_along_its_first_letter(name, chain):
    expected = 1e-6 * np.eye(3)[AXES.index(name[2])]
    assert moved(constant(**{name: 1e-6}), chain) == pytest.approx(expected, abs=1e-15)


def test_a_reading_grows_when_the_mirror_moves_along_the_beam():
    along_y = Alignment(np.eye(3)[1], np.eye(3)[1], np.zeros(3))
    before = reading(ENDS, along_y, constant(), "XYZ")[0]
    after = reading(ENDS, along_y, constant(E_YX=1e-6), "XYZ")[0]
    assert after - before == pytest.approx(1e-6, abs=1e-15)


@pytest.mark.parametrize(
    ("name", "offset", "expected"),
    [
        # right-handed: C turns +x to +y, A turns +y to +z, B turns +z to +x
        ("E_CX", (0.5, 0.0, 0.0), (0.0, +0.5, 0.0)),
        ("E_CX", (0.0, 0.5, 0.0), (-0.5, 0.0, 0.0)),
        ("E_AX", (0.0, 0.5, 0.0), (0.0, 0.0, +0.5)),
        ("E_AX", (0.0, 0.0, 0.5), (0.0, -0.5, 0.0)),
        ("E_BX", (0.0, 0.0, 0.5), (+0.5, 0.0, 0.0)),
        ("E_BX", (0.5, 0.0, 0.0), (0.0, 0.0, -0.5)),
    ],
)
def test_rotations_are_right_handed(name, offset, expected):
    errors = constant(**{name: 1e-6})
    # X is the last axis before the tool: the mirror's offset is the only lever.
    assert moved(errors, "YZX", offset) == pytest.approx(1e-6 * np.array(expected), abs=1e-12)


def test_a_rotation_acts_on_the_axes_after_it_in_the_chain_only():
    turned = constant(E_AX=1e-6)
    # Z (0.3 m) after X: y moves by -z·A.  Y (0.2 m) after X: z moves by +y·A.
    assert moved(turned, "YXZ") == pytest.approx([0.0, -0.3e-6, 0.0], abs=1e-12)
    assert moved(turned, "ZXY") == pytest.approx([0.0, 0.0, 0.2e-6], abs=1e-12)
    assert moved(turned, "YZX") == pytest.approx([0.0, 0.0, 0.0], abs=1e-12)
    x, y, z = levers(ENDS, "YXZ")
    assert x[0] == pytest.approx([0.0, 0.0, 0.3])
    assert y[0] == pytest.approx([0.1, 0.0, 0.3])
    assert z[0] == pytest.approx([0.0, 0.0, 0.0])


def test_rotation_matrices_of_known_angles():
    quarter = rotation_matrices(np.array([[0.0, 0.0, np.pi / 2]]))[0]
    assert quarter @ [1.0, 0.0, 0.0] == pytest.approx([0.0, 1.0, 0.0], abs=1e-15)
    third = rotation_matrices(2 * np.pi / 3 / np.sqrt(3) * np.ones((1, 3)))[0]
    assert third @ [1.0, 0.0, 0.0] == pytest.approx([0.0, 1.0, 0.0], abs=1e-15)
    assert third @ [0.0, 1.0, 0.0] == pytest.approx([0.0, 0.0, 1.0], abs=1e-15)


def test_reading_of_a_tilted_beam_and_mirror_in_a_plane():
    # Beam at angle b from +X, mirror normal at angle m; mirror point moves by w along X:
    # the length changes by w·cos(m)/cos(b - m).
    b, m, way = 0.02, -0.03, 0.1
    beam, normal = np.array([np.cos(b), np.sin(b), 0]), np.array([np.cos(m), np.sin(m), 0])
    lengths = reading(
        np.array([[0.0, 0.0, 0.0], [way, 0.0, 0.0]]),
        Alignment(beam, normal, np.array([-0.3, 0.0, 0.0])),
        constant(),
        "XYZ",
    )
    assert np.diff(lengths)[0] == pytest.approx(way * np.cos(m) / np.cos(b - m), abs=1e-16)


def random_machine(rng, scale):
    nodes = [np.linspace(low, low + 0.5, 6) for low in (0.1, -0.2, 0.05)]
    curves = {name: 1e-5 * scale * rng.standard_normal(6) for name in (*TRANSLATIONS, *ROTATIONS)}
    return ErrorCurves.from_curves(nodes, curves)


def second_order_part(chain, scale):
    rng = np.random.default_rng(4)
    errors = random_machine(rng, scale)
    positions = rng.uniform([0.1, -0.2, 0.05], [0.6, 0.3, 0.55], (40, 3))
    direction = beam_direction("pnp", np.array([0.01, 0.02, 0.015]))
    origin = np.array([-0.2, 0.4, -0.3])
    tilt = scale * np.array([3e-4, -2e-4])
    first, second = perpendiculars(direction)
    normal = tilted(direction, tilt)
    exact = reading(positions, Alignment(normal, normal, origin), errors, chain)
    linear = reading_first_order(
        positions, direction, tilt[0] * first + tilt[1] * second, origin, errors, chain
    )
    difference = exact - linear
    return np.max(np.abs(difference - difference[0]))


@pytest.mark.parametrize("chain", CHAINS)
def test_first_order_model_is_the_first_order_of_the_exact_one(chain):
    full, tenth = second_order_part(chain, 1.0), second_order_part(chain, 0.1)
    # What is left is quadratic: a hundredth at a tenth of all errors.
    assert full < 3e-7
    assert 60 < full / tenth < 140


def test_second_order_of_the_beams_direction():
    # |δl|²/2 - δl·δm, as a scale along the line
    direction = beam_direction("ppp", np.ones(3))
    beam, mirror = (3e-4, -5e-4), (-2e-4, 4e-4)
    ends = np.array([[0.0, 0.0, 0.0], 0.2 * direction])
    alignment = Alignment(tilted(direction, beam), tilted(direction, mirror), np.zeros(3))
    change = np.diff(reading(ends, alignment, constant(), "XYZ"))[0] - 0.2
    expected = 0.2 * (np.dot(beam, beam) / 2 - np.dot(beam, mirror))
    assert change == pytest.approx(expected, rel=1e-3)


def test_angular_equations_of_ibaraki_and_hata_corrected():
    """Eqs. (24)-(28) for unequal steps, chain YXZ, over one block with corners A … H."""
    a = np.array([0.010, 0.020, 0.015])
    corner = {
        name: a * np.array(at)
        for name, at in {
            "A": (0, 0, 0),
            "B": (1, 0, 0),
            "C": (1, 1, 0),
            "D": (0, 1, 0),
            "E": (0, 0, 1),
            "F": (1, 0, 1),
            "G": (1, 1, 1),
            "H": (0, 1, 1),
        }.items()
    }
    rng = np.random.default_rng(5)
    nodes = [np.array([0.0, step]) for step in a]
    angle = {name: 1e-7 * rng.standard_normal() for name in ROTATIONS}
    curves = {name: np.array([0.0, value]) for name, value in angle.items()}
    curves.update({name: 1e-7 * rng.standard_normal(2) for name in TRANSLATIONS})
    errors = ErrorCurves.from_curves(nodes, curves)

    def move(path, line):
        n = beam_direction(line, a)
        ends = np.array([corner[path[0]], corner[path[1]]])
        alignment = Alignment(n, n, -0.3 * n)
        return np.diff(reading(ends, alignment, errors, "YXZ"))[0]

    x, y, z = a
    length = np.linalg.norm(a)
    e = angle
    expected = [
        (y / length * (-z * e["E_AX"] + x * e["E_CX"]), "DA", "CB", "pnp"),
        (x / length * (z * e["E_BZ"] + y * e["E_CZ"]), "HG", "DC", "pnp"),
        (y / length * (z * e["E_AX"] + x * e["E_CX"]), "AD", "BC", "npp"),
        (y / length * (-z * e["E_AZ"] - x * e["E_CZ"]), "EH", "AD", "npp"),
        (x / length * (-z * e["E_BZ"] + y * e["E_CZ"]), "FE", "BA", "npp"),
    ]
    for value, one, other, line in expected:
        assert move(one, line) - move(other, line) == pytest.approx(value, abs=1e-13)


def test_squareness_is_the_right_handed_rotation_of_an_axis():
    angle = 1e-5
    for name, axis, about, other in (("C0Y", 1, 2, 0), ("B0Z", 2, 1, 0), ("A0Z", 2, 0, 1)):
        turned = rotation_matrices(angle * np.eye(3)[None, about])[0] @ np.eye(3)[axis]
        factor, (first, second) = SQUARENESS_SLOPES[name]
        assert first == f"E_{AXES[other]}{AXES[axis]}"
        assert second == f"E_{AXES[axis]}{AXES[other]}"
        assert factor * turned[other] == pytest.approx(angle, rel=1e-6)
        # and the angle between the positive axes
        larger = np.arccos(turned[other]) - np.pi / 2
        right_handed_to_over_90 = SQUARENESS_DEFINITIONS[OVER_90_DEGREES][name]
        assert larger == pytest.approx(right_handed_to_over_90 * angle, rel=1e-6)


def test_result_frame_is_that_of_equation_17_and_changes_no_squareness():
    rng = np.random.default_rng(6)
    nodes = [np.linspace(0.0, length, 9) for length in (0.1, 0.2, 0.3)]
    curves = {name: 1e-6 * rng.standard_normal(9) for name in TRANSLATIONS}
    framed = in_result_frame(nodes, curves)
    for name in ("E_YX", "E_ZX", "E_YZ"):
        assert framed[name][-1] == 0.0
    for name in TRANSLATIONS:
        assert framed[name][0] == 0.0

    def squareness(of, name):
        factor, pair = SQUARENESS_SLOPES[name]
        return factor * sum(np.polyfit(nodes[AXES.index(c[3])], of[c], 1)[0] for c in pair)

    for name in SQUARENESS_SLOPES:
        assert squareness(framed, name) == pytest.approx(squareness(curves, name), abs=1e-18)
    for name in ("E_XX", "E_YY", "E_ZZ"):
        assert framed[name] == pytest.approx(curves[name] - curves[name][0], abs=1e-20)


def test_curves_are_linear_between_nodes_and_constant_beyond():
    errors = ramp(E_YX=2e-6)
    at = errors.at(0, np.array([-1.0, 0.0, 0.025, 0.1, 5.0]))
    assert at[:, 1] == pytest.approx([0.0, 0.0, 0.5e-6, 2e-6, 2e-6], abs=1e-20)
    assert not np.any(at[:, [0, 2, 3, 4, 5]])


def test_wrong_curves_are_refused():
    with refused(Refusal, "unknown", "E_XQ"):
        ErrorCurves.from_curves(NODES, {"E_XQ": np.zeros(2)})
    with refused(Refusal, "mismatch", "E_XX", "3", "2"):
        ErrorCurves.from_curves(NODES, {"E_XX": np.zeros(3)})
    with refused(Refusal, "out_of_order"):
        ErrorCurves.from_curves([NODES[0][::-1], *NODES[1:]], {})
    with refused(Refusal, "out_of_range"):
        ErrorCurves.from_curves(NODES, {"E_XX": np.array([0.0, np.nan])})
    with refused(Refusal, "unknown", "XYY"):
        tool_point(ENDS, constant(), "XYY")


def test_cross_products_are_right_handed_and_fit_arrays_of_any_shape():
    x, y, z = np.eye(3)
    np.testing.assert_array_equal(cross(x, y), z)
    np.testing.assert_array_equal(cross(y, x), -z)
    random = np.random.default_rng(4)
    one, other = random.standard_normal((5, 2, 3)), random.standard_normal((2, 3))
    np.testing.assert_array_equal(cross(one, other), np.cross(one, other))


def test_perpendiculars_make_a_right_handed_triple():
    for line in ("x", "y", "z", "ppp", "npp", "pnp", "ppn"):
        n = beam_direction(line, np.array([0.01, 0.02, 0.03]))
        one, two = perpendiculars(n)
        triple = np.array([one, two, n])
        assert triple @ triple.T == pytest.approx(np.eye(3), abs=1e-15)
        assert np.linalg.det(triple) == pytest.approx(1.0)
        assert one[2] == 0.0
