"""The generator of the blind test: it is apart from the project, exact, and says what it hides."""

import ast
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from blind_cases import (
    CLASSES,
    draw_case,
    own_limits,
    readings_of,
    seal,
    unseal,
    write_case,
)
from blind_drivers import drivers_of
from blind_effects import ANGLES, INSIDE, KINDS, OUTSIDE, UNSEEN, Hidden, draw_hidden, roll_of
from blind_kinematics import Action, rotation_matrices, tool_frames
from blind_machine import Machine
from blind_plans import draw_plan, make_run
from blind_shapes import draw_curves, draw_noise
from blind_yardstick import Yardstick
from refused import refused

GENERATOR = (
    "cases",
    "drivers",
    "effects",
    "gross",
    "kinematics",
    "machine",
    "physics",
    "plans",
    "shapes",
    "strange",
    "tables",
    "weather",
    "yardstick",
)
HERE = Path(__file__).parent


def some_run(seed=3):
    return make_run(draw_plan(np.random.default_rng(seed), rich=True))


@pytest.mark.parametrize("name", GENERATOR)
def test_the_generator_knows_nothing_of_the_project(name):
    tree = ast.parse((HERE / f"blind_{name}.py").read_text())
    imported = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            imported |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            imported.add(node.module.split(".")[0])
    own = {f"blind_{other}" for other in GENERATOR}
    known = {"numpy", "scipy", "yaml", "csv", "dataclasses", "hashlib", "io", "itertools", "json"}
    known |= {"pathlib", "zlib"}
    assert imported <= own | known


def test_the_workflow_cannot_import_the_generator():
    package = HERE.parents[1] / "stepdiag_ros"
    for path in package.rglob("*.py"):
        assert "blind_" not in path.read_text(), path


def test_rotations_are_exact():
    rng = np.random.default_rng(0)
    vectors = rng.standard_normal((5, 3))
    matrices = rotation_matrices(vectors)
    for vector, matrix in zip(vectors, matrices, strict=True):
        np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-14)
        np.testing.assert_allclose(matrix @ vector, vector, atol=1e-14)
        angle = np.linalg.norm(vector)
        assert math.isclose(np.trace(matrix), 1.0 + 2.0 * math.cos(angle), abs_tol=1e-13)
    quarter = rotation_matrices(np.array([[0.0, 0.0, np.pi / 2.0]]))[0]
    np.testing.assert_allclose(quarter @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], atol=1e-15)


def test_an_axis_turns_what_stands_on_it_and_no_other():
    # Chain XYZ from workpiece to tool: Z's rotation about Y moves no tool point, X's about Y does.
    position = np.array([[0.1, 0.2, 0.3]])
    turn = np.zeros((3, 1, 3))
    turn[2, 0, 1] = 1e-3
    nothing = np.zeros((3, 1, 3))
    pose = tool_frames("XYZ", position, nothing, turn)
    np.testing.assert_allclose(pose[0, :3, 3], position[0], atol=1e-15)
    turn = np.zeros((3, 1, 3))
    turn[0, 0, 1] = 1e-3
    pose = tool_frames("XYZ", position, nothing, turn)
    expected = [0.1 + 0.3 * math.sin(1e-3), 0.2, 0.3 * math.cos(1e-3)]
    np.testing.assert_allclose(pose[0, :3, 3], expected, atol=1e-15)


def test_what_a_beam_off_its_way_reads():
    case = draw_case("none", 4)
    machine = Machine(4, case.plan)
    machine.curves = np.zeros_like(machine.curves)
    machine.mirror_tilt = machine.beam_tilt
    run = machine.run()
    shown = machine.shown(run, Action.none(len(run.time)))
    beam = machine.alignment(run)[0]
    # A mirror that returns the beam tells the projection on the beam's real direction.
    np.testing.assert_allclose(shown, np.sum((run.position - run.start) * beam, axis=1), atol=1e-15)
    assert np.abs(np.linalg.norm(np.cross(beam, run.beam), axis=1)).max() > 0.02e-3


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_every_effect_acts_in_proportion_to_its_size(kind):
    rng = np.random.default_rng(11)
    case = draw_case("one", 2)
    machine = Machine(2, case.plan)
    run = machine.run()
    hidden = draw_hidden(rng, kind, run)
    without = machine.shown(run, Action.none(len(run.time)))
    one, ten = (
        (machine.shown(run, hidden.act(run, size)) - without) / size for size in (1e-8, 1e-7)
    )
    assert np.abs(one).max() > 0.0
    np.testing.assert_allclose(one, ten, atol=2e-4 * np.abs(ten).max())


def test_the_signs_of_the_effects_are_those_of_the_printed_cases():
    run = some_run()
    n = len(run.time)
    x = run.position[:, 0]
    senses = run.came[:, 0]
    np.testing.assert_allclose(
        Hidden("backlash", {"axis": "X"}).act(run, 2.0).shift[0, :, 0], -senses
    )
    np.testing.assert_allclose(
        Hidden("settling", {"axis": "X"}).act(run, 2.0).shift[0, :, 0], -2.0 * run.moved[:, 0]
    )
    np.testing.assert_allclose(
        Hidden("growth", {"axis": "X"}).act(run, 2.0).shift[0, :, 0],
        2.0 * x * (run.material - 20.0),
    )
    np.testing.assert_allclose(Hidden("dead_path").act(run, 2.0).reading, 2.0 * (run.air - 20.0))
    turn = Hidden("angular", {"error": "E_CX"}).act(run, 2.0).turn
    np.testing.assert_allclose(turn[0, :, 2], 2.0 * x / run.travel[0])
    assert np.count_nonzero(turn) == np.count_nonzero(turn[0, :, 2])
    setting = {"setup": 1, "repeat": 1, "direction": "forward", "stop": 3}
    slipped = Hidden("slip", setting).act(run, 2.0).reading
    first = int(np.argmax(slipped != 0.0))
    assert run.rows[first][3:] == (1, "forward", 3) and run.setup[first] == 1
    # The counter stays off until the next zero, that of the next setup.
    after = np.arange(n) >= first
    np.testing.assert_array_equal(slipped != 0.0, after & (run.setup == 1))


def test_curves_begin_at_zero_and_straightness_has_waves():
    curves = draw_curves(np.random.default_rng(1), 12)
    assert np.all(curves[:, 0] == 0.0)
    share = np.linspace(0.0, 1.0, 13)
    for axis in range(3):
        for component in set(range(3)) - {axis}:
            curve = curves[axis, :, component]
            smooth = np.polynomial.Polynomial.fit(share, curve, 3)(share)
            assert np.std(curve - smooth) > 0.1e-6


def test_noise_has_the_stated_size_and_a_slight_memory():
    memories = []
    for seed in range(40):
        noise = draw_noise(np.random.default_rng(seed), 4000, 0.1e-6)
        assert abs(np.std(noise) / 0.1e-6 - 1.0) < 0.06
        memories.append(np.corrcoef(noise[1:], noise[:-1])[0, 1])
    assert min(memories) > -0.05 and 0.15 < max(memories) < 0.25


@pytest.mark.parametrize("kind", CLASSES)
def test_a_case_is_its_seed_and_the_project_reads_its_table(kind, tmp_path):
    from stepdiag_ros.bags.table import load_table

    case = draw_case(kind, 5, largest=900)
    sizes = [sign * limit for sign, limit in zip(case.signs, own_limits(case), strict=True)]
    first, second = tmp_path / "first", tmp_path / "second"
    write_case(first, case, sizes)
    write_case(second, draw_case(kind, 5, largest=900), sizes)
    text = (first / "run.csv").read_text()
    assert text == (second / "run.csv").read_text()
    table = load_table(first / "run.csv")
    assert table.setups == len(case.plan.setups)
    assert table.measurement.chain == case.plan.chain
    # Neither the table nor the case file tells what is hidden, or how large the noise is.
    told = text.splitlines()[0] + (first / "case.yaml").read_text()
    assert not any(hidden.kind in told for hidden in case.hidden)
    assert ("noise" in told) == case.plan.told_noise
    write_case(second, case, sizes, noise_stream=1)
    assert text != (second / "run.csv").read_text()


def test_the_classes_hide_what_they_say():
    for seed in range(3):
        assert draw_case("none", seed).hidden == ()
        assert draw_case("one", seed).hidden[0].kind in INSIDE
        assert len({hidden.kind for hidden in draw_case("two", seed).hidden}) == 2
        assert draw_case("outside", seed).hidden[0].kind in OUTSIDE
        assert draw_case("unseen", seed).hidden[0].kind in UNSEEN
        pair = draw_case("pair", seed)
        machine = Machine(seed, pair.plan)
        run = machine.run()
        changes = [machine.signature(run, hidden) for hidden in (pair.hidden[0], pair.twin)]
        yardstick = Yardstick(run)
        assert yardstick.alike(*changes) > 0.99
        assert pair.hidden[0] != pair.twin and abs(np.corrcoef(*changes)[0, 1]) < 0.99999


def test_each_kind_outside_has_its_turn_and_says_what_drives_it():
    cases = [draw_case("outside", seed, largest=900) for seed in range(len(OUTSIDE))]
    assert {case.hidden[0].kind for case in cases} == set(OUTSIDE)
    assert {case.level for case in cases} == {3.0}
    for case in cases:
        told = drivers_of(case.hidden[0], make_run(case.plan))
        assert set(told.acts_on) <= {*"XYZ", "reading"} and told.quantities


@pytest.mark.parametrize("kind", OUTSIDE)
def test_a_displacement_is_along_the_axes_that_are_said_to_move(kind):
    run = some_run()
    hidden = draw_hidden(np.random.default_rng(4), kind, run)
    told = drivers_of(hidden, run)
    action = hidden.act(run, 1e-6)
    # A turn moves the tool by its arms, too.
    pose = tool_frames(run.plan.chain, run.position, action.shift, action.turn)
    moved = np.abs(pose[:, :3, 3] - run.position).max(axis=0) > 1e-10
    said = {axis for axis, moves in zip("XYZ", moved, strict=True) if moves}
    if np.any(action.reading):
        said.add("reading")
    assert (said or {"reading"}) == set(told.acts_on)


@pytest.mark.parametrize("kind", OUTSIDE)
def test_what_is_said_to_drive_an_effect_is_all_that_it_depends_on(kind):
    """Any two stops at which these quantities are the same have the same effect."""
    run = some_run()
    # A place of the box in one stop and another: only what is said may tell them apart.
    rng = np.random.default_rng(5)
    hidden = draw_hidden(rng, kind, run)
    told = drivers_of(hidden, run)
    free = ["XYZ".index(axis) for axis in "XYZ" if f"place {axis}" not in told.quantities]
    if "path" in told.quantities:
        free = []
    elsewhere = run.position.copy()
    elsewhere[:, free] = rng.permutation(elsewhere[:, free])
    other = replace(run, position=elsewhere)
    if "material" not in told.quantities:
        other = replace(other, material=run.material + 5.0, air=run.air - 3.0)
    senses = [f"sense {axis}" in told.quantities for axis in "XYZ"]
    if told.lasting:
        other = replace(other, came=np.where(senses, run.came, -run.came))
    frames = [
        tool_frames(one.plan.chain, one.position, action.shift, action.turn)[:, :3, 3]
        - one.position
        for one, action in ((one, hidden.act(one, 1e-6)) for one in (run, other))
    ]
    np.testing.assert_allclose(*frames, atol=1e-12)
    np.testing.assert_allclose(
        hidden.act(run, 1e-6).reading, hidden.act(other, 1e-6).reading, atol=1e-12
    )


def test_a_plan_of_many_repeats_keeps_one_order_of_each_line():
    case = draw_case("outside", 0, largest=5000, repeats=12)
    assert all(12 <= setup.repeats < 16 for setup in case.plan.setups)
    lines = [(setup.kind, setup.line) for setup in case.plan.setups]
    assert len(lines) == len(set(lines)) == 7
    assert case.name == "outside-0-x12"


def test_the_yardstick_sees_neither_curves_nor_tilts_nor_squareness():
    case = draw_case("none", 9)
    machine, other = Machine(9, case.plan), Machine(10, case.plan)
    run = machine.run()
    change = machine.shown(run, Action.none(len(run.time)))
    machine.curves, machine.beam_tilt = other.curves, other.beam_tilt
    machine.mirror_tilt = other.beam_tilt
    change = machine.shown(run, Action.none(len(run.time))) - change
    left = Yardstick(run).signature(change)
    assert np.abs(change).max() > 10e-6
    # Second order: squares of the tilts times the way, and tilts times the curves.
    assert np.abs(left).max() < 0.15e-6
    angles = [machine.signature(run, Hidden("angular", {"error": error})) for error in ANGLES]
    assert max(Yardstick(run).visible(angle) for angle in angles) > 0.05


@pytest.mark.parametrize("kind", sorted(set(UNSEEN) - {"nonlinearity"}))
def test_what_nobody_can_see_is_there_and_hides_in_the_free_parameters(kind):
    case = draw_case("none", 9)
    machine = Machine(9, case.plan)
    machine.beam_tilt = machine.mirror_tilt = np.zeros_like(machine.beam_tilt)
    run = machine.run()
    change = machine.signature(run, draw_hidden(np.random.default_rng(0), kind, run))
    assert np.ptp(change) > 0.01
    assert Yardstick(run).visible(change) < 1e-4


def test_a_mirror_elsewhere_on_the_tool_is_carried_by_the_roll_that_nobody_else_sees():
    case = draw_case("none", 9)
    machine = Machine(9, case.plan)
    run = machine.run()
    setup = next(n for n, one in enumerate(case.plan.setups) if one.order)
    axis = case.plan.chain[0]
    change = machine.signature(run, Hidden("abbe", {"setup": setup, "axis": axis}))
    here = run.setup == setup
    share = run.position[here, "XYZ".index(axis)] / run.travel["XYZ".index(axis)]
    roll = machine.signature(run, Hidden("roll", {"error": roll_of(case.plan.chain)}), 1e-6)
    # What the size tells, beside the roll's own part, which is one of straightness.
    arm = np.linalg.norm(np.cross(np.eye(3)["XYZ".index(axis)], run.beam[here][0]))
    own = change[here] - roll[here] / (0.1 * arm)
    np.testing.assert_allclose(np.abs(own), np.abs(share - share[0]), atol=2e-3)
    assert Yardstick(run).visible(change) > 0.02


def test_light_swings_with_the_mirror_s_way_in_half_waves():
    case = draw_case("none", 9)
    machine = Machine(9, case.plan)
    run = machine.run()
    shown = machine.shown(run, Action.none(len(run.time)))
    size = 10e-9
    swing = machine.signature(run, Hidden("nonlinearity", {"setup": 3, "part": 2}), size)
    here = run.setup == 3
    assert not np.any(swing[~here]) and np.abs(swing[here]).max() > 0.5
    # To the first order in the amplitude: sin(2 pi s / (wavelength / 4)), from the zero on.
    first = np.flatnonzero(here)[0]
    beam, _, source = machine.alignment(run)
    assert np.linalg.norm(run.start[first] - source[first]) == pytest.approx(run.dead_path)
    phase = 2.0 * np.pi * shown[here] / (632.8e-9 / 4.0)
    expected = np.column_stack([np.sin(phase), np.cos(phase), np.ones(len(phase))])
    left = swing[here] - expected @ np.linalg.lstsq(expected, swing[here], rcond=None)[0]
    assert np.abs(left).max() < 1e-4 and np.allclose(beam[here], beam[first])


def test_an_effect_of_its_own_limit_stands_out_of_the_noise_that_much():
    case = draw_case("one", 12)
    (limit,) = own_limits(case)
    yardstick = Yardstick(Machine(12, case.plan).run())
    signature = yardstick.signature(
        Machine(12, case.plan).signature(make_run(case.plan), case.hidden[0])
    )
    unit = signature / np.linalg.norm(signature)
    amplitudes = []
    for stream in range(12):
        _, readings = readings_of(case, (limit,), stream)
        amplitudes.append(float(unit @ yardstick.signature(readings)) / case.plan.noise)
    assert abs(np.mean(amplitudes) - 7.0) < 1.0


def test_a_seal_that_was_changed_is_refused(tmp_path):
    case = draw_case("one", 1)
    path = tmp_path / "seal"
    digest = seal(path, case, (1e-6,), {"labels": []})
    assert unseal(path, digest)["sizes"] == [1e-6]
    assert (
        b"hidden" not in path.read_bytes() and case.hidden[0].kind.encode() not in path.read_bytes()
    )
    seal(path, case, (2e-6,), {"labels": []})
    with refused(ValueError, None, "seal"):
        unseal(path, digest)
