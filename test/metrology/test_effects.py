"""The catalogue of effects: signatures against physics that is written again here."""

import sys
from dataclasses import replace
from importlib.metadata import EntryPoint

import numpy as np
import pytest
from cells_for_tests import make_cell, make_plan
from refused import a_fault, refused

from stepdiag_ros.metrology import effects, registry
from stepdiag_ros.metrology.discrepancy import diagnose
from stepdiag_ros.metrology.effects import catalogue
from stepdiag_ros.metrology.effects.backlash import Backlash
from stepdiag_ros.metrology.effects.effect import ActiveEffect, Change, Effect, Key, Size
from stepdiag_ros.metrology.effects.learned_shape import LearnedShape
from stepdiag_ros.metrology.effects.stops import stops_of
from stepdiag_ros.metrology.forward import ErrorCurves, reading, tilted
from stepdiag_ros.metrology.geometry import AXES, ROTATIONS
from stepdiag_ros.metrology.live_effects import LiveEffects
from stepdiag_ros.metrology.measurement import Environment
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.simulation import simulate

STEP = (0.01, 0.012, 0.009)
BLOCKS = 6
TRAVEL = np.array(STEP) * BLOCKS
ORIGIN = (0.05, -0.02, 0.1)


def varied(measurement):
    """Give the measurement weather and material that change in different ways."""
    lines = []
    for line in measurement.lines:
        hours = line.time / 3600.0
        columns = Environment(
            air_temperature=20.4 + 3.0 * np.sin(9.0 * hours),
            air_pressure=100900.0 + 4000.0 * hours**2,
            relative_humidity=0.4 + 0.3 * hours,
            material_temperature=20.2 + 2.0 * np.sqrt(hours),
        )
        lines.append(replace(line, environment=np.column_stack(columns)))
    return replace(measurement, lines=tuple(lines))


@pytest.fixture(scope="module", params=["YXZ", "ZYX"])
def measurement(request):
    plan = make_plan(
        blocks=BLOCKS,
        step=STEP,
        origin=ORIGIN,
        orders=("XYZ", "YZX"),
        repeats=2,
        directions=("forward", "backward"),
    )
    cell = make_cell(chain=request.param, noise=0.0, low=(-0.1,) * 3, high=(0.3,) * 3)
    return varied(simulate(plan, cell))


@pytest.fixture(scope="module")
def stops(measurement):
    return stops_of(measurement)


def every_setting(stops):
    return [
        (effect, setting) for effect in catalogue().values() for setting in effect.settings(stops)
    ]


def each_name_once(stops):
    """Keep one setting of each effect for each axis, curve or setup: not every pass and stop."""
    kept = {}
    for effect, setting in every_setting(stops):
        words = tuple(str(value) for value in setting.values() if isinstance(value, str))
        kept[effect.name, words] = (effect, setting)
    return list(kept.values())


# --- what the mirror does, straight from positions: the physics of each effect once more ---


def exact(stops, curves):
    """Return the exact change of every reading by error curves over fine nodes."""
    nodes = [np.linspace(0.0, length, 2001) for length in TRAVEL]
    fine = ErrorCurves.from_curves(
        nodes, {name: curve(nodes[AXES.index(name[3])]) for name, curve in curves.items()}
    )
    nothing = ErrorCurves.from_curves(nodes, {})
    change = np.zeros(len(stops.time))
    for index in range(len(stops.setups)):
        rows = stops.setup == index
        direction, start = stops.direction[rows][0], stops.start[rows][0]
        beam = tilted(direction, (0.0, 0.0))

        class At:
            pass

        At.beam, At.mirror_normal, At.origin = beam, beam, start - 0.3 * beam
        place = stops.position[rows]
        change[rows] = reading(place, At, fine, stops.chain) - reading(
            place, At, nothing, stops.chain
        )
    return change


def by_hand(stops, turn):
    """Return the change by a function of one stop: (row) → displacement of the mirror, m."""
    return np.array([stops.direction[row] @ turn(row) for row in range(len(stops.time))])


@pytest.mark.parametrize("error", ROTATIONS)
def test_angular_errors_do_what_the_exact_machine_does(stops, error):
    length = TRAVEL[AXES.index(error[3])]
    for name, curve in (
        ("angular error", lambda q: 1e-6 * (q / length)),
        ("wavy angular error", lambda q: 1e-6 * (q / length)),
    ):
        column = catalogue()[name].columns({"error": error}, stops)[:, 0]
        assert column * 1e-6 == pytest.approx(exact(stops, {error: curve}), abs=1e-12)
    column = catalogue()["angular error"].columns({"error": error}, stops)[:, 1]
    assert column * 1e-6 == pytest.approx(
        exact(stops, {error: lambda q: 1e-6 * (q / length) ** 2}), abs=1e-12
    )
    column = catalogue()["wavy angular error"].columns({"error": error}, stops)[:, 4]
    assert column * 1e-6 == pytest.approx(
        exact(stops, {error: lambda q: 1e-6 * (np.cos(4 * np.pi * q / length) - 1.0)}), abs=1e-12
    )


def test_scale_period_and_squareness_do_what_the_exact_machine_does(stops):
    known = catalogue()
    for axis in AXES:
        column = known["scale"].columns({"axis": axis}, stops)[:, 0]
        curve = {f"E_{axis}{axis}": lambda q: 1e-6 * q}
        assert column * 1e-6 == pytest.approx(exact(stops, curve), abs=1e-15)
        columns = known["pitch-periodic error"].columns({"axis": axis, "period_m": 7e-3}, stops)
        curve = {f"E_{axis}{axis}": lambda q: 1e-7 * np.sin(2 * np.pi * q / 7e-3)}
        assert columns[:, 0] * 1e-7 == pytest.approx(exact(stops, curve), abs=3e-11)
    # Right-handed: +C0Y turns the Y axis towards -X, +B0Z the Z axis towards +X, +A0Z towards -Y.
    for angle, curve, sign in (("C0Y", "E_XY", -1), ("B0Z", "E_XZ", 1), ("A0Z", "E_YZ", -1)):
        column = known["squareness"].columns({"angle": angle}, stops)[:, 0]
        expected = exact(stops, {curve: lambda q, sign=sign: sign * 1e-6 * q})
        assert column * 1e-6 == pytest.approx(expected, abs=1e-15)


def test_the_sense_of_the_last_move_is_that_of_the_axis_itself(stops):
    """Walk the stops as the machine does and keep each axis's last sense by hand."""
    known = catalogue()
    for letter in AXES:
        axis = AXES.index(letter)
        last, setup, expected, settled = 0.0, -1, [], []
        for row in range(len(stops.time)):
            if stops.setup[row] != setup:
                last, setup, before = 0.0, stops.setup[row], stops.position[row, axis]
            step = stops.position[row, axis] - before
            before = stops.position[row, axis]
            last = np.sign(step) if abs(step) > 1e-9 else last
            along = stops.direction[row, axis]
            expected.append(-0.5 * last * along)
            first = stops.number[row] == 0
            settled.append(0.0 if first or abs(step) < 1e-9 else -np.sign(step) * along)
        assert known["backlash"].columns({"axis": letter}, stops)[:, 0] == pytest.approx(expected)
        assert known["settling"].columns({"axis": letter}, stops)[:, 0] == pytest.approx(settled)


def test_the_machine_is_late_along_its_path(stops):
    lag, delay = [], []
    for row in range(len(stops.time)):
        way = stops.position[row] - stops.position[row - 1]
        if stops.number[row] == 0:
            lag.append(0.0)
            delay.append(0.0)
            continue
        lag.append(-stops.direction[row] @ way / np.linalg.norm(way))
        delay.append(stops.direction[row] @ way / (stops.time[row] - stops.time[row - 1]))
    assert catalogue()["servo lag"].columns({}, stops)[:, 0] == pytest.approx(lag)
    assert catalogue()["position-trigger delay"].columns({}, stops)[:, 0] == pytest.approx(delay)


def test_effects_of_temperature_and_time(stops):
    known = catalogue()
    material, air, time = stops.material_temperature, stops.air_temperature, stops.time
    for axis, letter in enumerate(AXES):
        unit = np.eye(3)[axis]
        place = stops.position[:, axis]
        for name, further, factor in (
            ("thermal growth", {}, place * (material - 20.0)),
            ("growth with time", {}, place * time),
            ("warm-up growth", {"time_constant_s": 90.0}, place * (1.0 - np.exp(-time / 90.0))),
        ):
            column = known[name].columns({"axis": letter, **further}, stops)[:, 0]
            by = by_hand(stops, lambda row, by=factor, unit=unit: by[row] * unit)
            assert column == pytest.approx(by, abs=1e-15), name
        column = known["drift"].columns({"along": letter}, stops)[:, 0]
        assert column == pytest.approx(time * stops.direction[:, axis])
        column = known["warm-up drift"].columns({"along": letter, "time_constant_s": 90.0}, stops)
        assert column[:, 0] == pytest.approx((1 - np.exp(-time / 90.0)) * stops.direction[:, axis])
    assert known["drift"].columns({"along": "beam"}, stops)[:, 0] == pytest.approx(time)
    assert known["dead path"].columns({}, stops)[:, 0] == pytest.approx(air - 20.0)
    assert known["dead path by pressure"].columns({}, stops)[:, 0] == pytest.approx(
        stops.air_pressure - 101325.0
    )


def test_effects_on_the_length_of_the_beam(stops):
    known = catalogue()
    way = stops.position - stops.start
    along = np.array([n @ w for n, w in zip(stops.direction, way, strict=True)])
    material, air, pressure = stops.material_temperature, stops.air_temperature, stops.air_pressure
    for name, factor in (
        ("wrong wavelength", 1.0),
        ("wrong expansion coefficient", material - 20.0),
        ("uncompensated air temperature", air - 20.0),
        ("uncompensated air pressure", pressure - 101325.0),
        ("uncompensated air humidity", stops.relative_humidity - 0.5),
    ):
        assert known[name].columns({}, stops)[:, 0] == pytest.approx(along * factor), name
    # The well-known coefficients of the index of air: -0.93e-6 a kelvin, 2.68e-9 a pascal and
    # -0.85e-6 from dry to saturated air.
    rule = (
        -0.93e-6 * (air - 20.0)
        + 2.68e-9 * (pressure - 101325.0)
        - 0.85e-6 * (stops.relative_humidity - 0.5)
    )
    column = known["uncompensated air"].columns({}, stops)[:, 0]
    assert column == pytest.approx(along * rule, abs=0.03 * np.max(np.abs(along * rule)))
    assert np.max(np.abs(column)) > 1e-8


def test_effects_of_one_setup_leave_the_others_alone(stops):
    known = catalogue()
    setup = "npp YZX"
    here = stops.setup == stops.setups.index(setup)
    start, direction = stops.start[here][0], stops.direction[here][0]
    along = (stops.position - start) @ direction
    across = (stops.position - start) - along[:, None] * direction
    sizes = {"first": 2e-4, "second": -1e-4}
    tilt = ActiveEffect(known["mirror tilt under travel"], {"setup": setup}, sizes)
    # The exact reading off a plane with a turned normal, less that off the upright plane.
    moved = np.array([np.linalg.norm(TRAVEL)])
    expected = np.zeros(len(stops.time))
    first = np.array([-direction[1], direction[0], 0.0])
    first /= np.linalg.norm(first)
    second = np.cross(direction, first)
    for row in np.flatnonzero(here):
        normal = direction + along[row] / moved[0] * (2e-4 * first - 1e-4 * second)
        place = stops.position[row] - start
        expected[row] = place @ normal / (direction @ normal) - along[row]
    assert tilt.readings(stops) == pytest.approx(expected, abs=1e-11)
    assert known["cosine error"].columns({"setup": setup}, stops)[:, 0] == pytest.approx(
        np.where(here, along, 0.0)
    )
    columns = known["Abbe offset"].columns({"setup": setup, "axis": "Y"}, stops)
    share = stops.position[:, 1] / TRAVEL[1]
    assert columns[:, 0] == pytest.approx(np.where(here, share, 0.0))
    assert columns[:, 1] == pytest.approx(np.where(here, share**2, 0.0))
    walk = known["beam walk on the mirror"].columns({}, stops)[:, 0]
    radius = 50.0
    sagitta = radius - np.sqrt(radius**2 - np.sum(across**2, axis=1))
    assert walk[here] / radius == pytest.approx(sagitta[here], rel=1e-6, abs=1e-12)
    linear = stops.setup == stops.setups.index("x")
    assert walk[linear] == pytest.approx(0.0, abs=1e-15)


def test_a_turn_of_an_axis_under_another_mirror_offset_is_the_abbe_offset(stops):
    """ε(q)·offset at the mirror, exactly, in one setup: only the product of both can be told."""
    offset, turn = np.array([0.0, 0.07, 0.0]), 20e-6
    setup = stops.setups.index("ppp XYZ")
    rows = stops.setup == setup
    direction = stops.direction[rows][0]
    angles = turn * stops.position[rows, 0] / TRAVEL[0]
    moved = np.column_stack([-np.sin(angles), np.cos(angles) - 1.0, 0.0 * angles]) * offset[1]
    size = -turn * offset[1] * direction[0]
    column = catalogue()["Abbe offset"].columns({"setup": "ppp XYZ", "axis": "X"}, stops)[rows, 0]
    assert size * column == pytest.approx(moved @ direction, abs=2e-11)


def test_a_slip_stays_to_the_end_of_its_setup_and_a_break_to_the_end_of_its_pass(stops):
    setting = {
        "line": "npp",
        "order": "YZX",
        "repeat": 0,
        "direction": "backward",
        "from_stop": 5,
    }
    known = catalogue()
    slip = known["fringe slip"].columns(setting, stops)[:, 0]
    broken = known["beam-break jump"].columns(setting, stops)[:, 0]
    for row in range(len(stops.time)):
        line = stops.lines[stops.pass_index[row]]
        same = line.name == "npp" and line.order == "YZX"
        within = same and (line.repeat, line.direction) == (0, "backward")
        assert broken[row] == (within and stops.number[row] >= 5)
        assert slip[row] == ((within and stops.number[row] >= 5) or (same and line.repeat == 1))
    assert known["fringe slip"].label(setting) == (
        "fringe slip on npp YZX backward, repeat 0, from stop 5"
    )
    with refused(Refusal, "not_found", "npp", "XZY", "0"):
        known["fringe slip"].columns({**setting, "order": "XZY"}, stops)
    with refused(Refusal, "not_found", "500"):
        known["fringe slip"].columns({**setting, "from_stop": 500}, stops)
    with refused(Refusal, "not_found", "zzz"):
        known["cosine error"].columns({"setup": "zzz"}, stops)


def test_sag_grows_with_the_product_of_two_positions(stops):
    share = stops.position / TRAVEL
    column = catalogue()["sag"].columns({"error": "Z", "over": "XY"}, stops)[:, 0]
    assert column == pytest.approx(share[:, 0] * share[:, 1] * stops.direction[:, 2])


def test_nonlinearity_follows_the_phase_of_the_light(stops):
    """A reading that is a whole number of periods of the wavelength in air later swings alike."""
    effect = catalogue()["interferometer nonlinearity"]
    setting = {"setup": "ppp XYZ", "period_m": 632.99e-9 / 2}
    rows = stops.setup == stops.setups.index("ppp XYZ")
    columns = effect.columns(setting, stops)
    assert np.all(columns[~rows] == 0.0) and np.ptp(columns[rows, 0]) > 1.5
    assert columns[rows, 0] ** 2 + (columns[rows, 1] + 1.0) ** 2 == pytest.approx(1.0)
    still = replace(stops, air_temperature=np.full(len(stops.time), 20.0))
    air = 632.99e-9 / 2 / 1.00027
    nearby = replace(still, displacement=still.displacement + air)
    assert effect.columns(setting, nearby) == pytest.approx(
        effect.columns(setting, still), abs=2e-4
    )


# --- what holds of all of them ---


def test_every_effect_shows_itself_on_a_rich_run_under_a_label_of_its_own(stops):
    known = catalogue()
    assert len(known) >= 28
    labels = []
    for name, effect in known.items():
        settings = list(effect.settings(stops))
        # What is learned is described after a run, not tried on one.
        assert bool(settings) is not effect.learned, name
        labels += [effect.label(setting) for setting in settings]
        for setting in settings:
            assert list(setting) == [key.name for key in effect.keys], name
        for size in effect.sizes:
            # A typical size is a standard deviation, which has no sign.
            assert size.low == 0.0 if effect.typical else size.low < 0.0, name
            assert size.high > 0.0 and size.meaning and size.unit, name
        assert effect.sentence.endswith(".") and effect.source, name
    assert len(set(labels)) == len(labels)


def test_every_effect_is_linear_in_its_sizes(stops):
    rng = np.random.default_rng(5)
    for effect, setting in each_name_once(stops):
        if effect.typical:
            # How many unknown errors scatter; which way each of them acts, the size does not say.
            continue
        columns = effect.columns(setting, stops)
        assert columns.shape == (len(stops.time), len(effect.sizes))
        assert np.all(np.isfinite(columns)) and np.all(np.any(columns != 0.0, axis=0)), effect.name
        sizes = [rng.uniform(size.low, size.high) for size in effect.sizes]
        named = {size.name: value for size, value in zip(effect.sizes, sizes, strict=True)}
        made = ActiveEffect(effect, setting, named).readings(stops)
        assert made == pytest.approx(columns @ sizes, rel=1e-9, abs=1e-18), effect.name


def test_a_poor_run_offers_only_what_it_can_show():
    """One linear axis, one way, chain and weather unknown."""
    plan = make_plan(blocks=BLOCKS, diagonals=(), linear=("x",))
    measurement = simulate(plan, make_cell(noise=0.0))
    line = measurement.lines[0]
    unknown = replace(line, environment=np.full_like(line.environment, np.nan))
    stops = stops_of(replace(measurement, lines=(unknown,), chain=""))
    offered = {effect.name for effect, _ in every_setting(stops)}
    for name in (
        "angular error", "wavy angular error", "squareness", "backlash", "servo lag", "dead path",
        "thermal growth", "uncompensated air", "wrong expansion coefficient", "Abbe offset",
        "sag", "beam walk on the mirror", "mirror tilt under travel", "beam-break jump",
    ):  # fmt: skip
        assert name not in offered, name
    assert {"scale", "settling", "drift", "fringe slip", "cosine error"} <= offered


def test_weather_that_never_leaves_the_reference_shows_nothing(measurement):
    steady = np.array(Environment(20.0, 101325.0, 0.5, 20.0))
    lines = tuple(
        replace(line, environment=np.tile(steady, (len(line.time), 1)))
        for line in measurement.lines
    )
    stops = stops_of(replace(measurement, lines=lines))
    offered = {effect.name for effect, _ in every_setting(stops)}
    assert not {name for name in offered if "uncompensated" in name or "dead path" in name}
    assert not {"thermal growth", "wrong expansion coefficient"} & offered


def test_one_temperature_is_not_called_by_two_names(stops):
    """With steady pressure and humidity, all of the air is its temperature."""
    count = len(stops.time)
    steady = replace(stops, air_pressure=np.full(count, 1e5), relative_humidity=np.full(count, 0.4))
    offered = {effect.name for effect, _ in every_setting(steady) if "air" in effect.name.split()}
    assert "uncompensated air temperature" in offered and "uncompensated air" not in offered
    # Pressure 1325 Pa below the standard shortens every reading: hidden, but it does something.
    assert "uncompensated air pressure" in offered


def test_a_pass_that_was_measured_again_is_later_than_its_place(measurement):
    """Backlash goes by the order in which the machine moved, not by that of the plan."""
    lines = list(measurement.lines)
    plain = stops_of(measurement)
    index = next(i for i, line in enumerate(lines) if str(line.line) == "x forward, repeat 0")
    late = max(line.end_time for line in lines if line.setup == "x") + 10**9
    lines[index] = replace(lines[index], end_time=late, attempt=2)
    again = stops_of(replace(measurement, lines=tuple(lines)))
    first = plain.pass_index == index
    assert plain.last_sense[first][0, 0] == 0.0
    # The backward pass before it has ended at its first stop, moving down.
    assert again.last_sense[first][0, 0] == -1.0
    assert np.all(again.last_sense[first][1:, 0] == 1.0)


def test_a_run_up_tells_from_which_side_the_first_stop_is_approached(measurement):
    """ISO 230-2 runs begin beyond their first target: the whole lost motion is at every stop."""
    lines = tuple(
        replace(line, overrun=0.002 if line.line.kind == "linear" else 0.0)
        for line in measurement.lines
    )
    plain, stops = stops_of(measurement), stops_of(replace(measurement, lines=lines))
    for index, line in enumerate(lines):
        rows = stops.pass_index == index
        if line.line.kind == "linear":
            axis = "xyz".index(line.line.name)
            sense = 1.0 if line.line.direction == "forward" else -1.0
            expected = np.zeros(3)
            expected[axis] = 0.002 * sense
            np.testing.assert_allclose(stops.way[rows][0], expected, atol=1e-15)
            assert np.all(stops.moved[rows][:, axis] == sense)
            assert np.all(stops.last_sense[rows][:, axis] == sense)
        else:
            assert np.array_equal(stops.moved[rows], plain.moved[rows])
            assert np.all(stops.way[rows][0] == 0.0)
    backlash = Backlash()
    change = backlash.change({"axis": "X"}, {"lost_motion": 1e-6}, stops).translation[:, 0]
    for index, line in enumerate(lines):
        if line.line.name == "x":
            up = line.line.direction == "forward"
            assert np.all(change[stops.pass_index == index] == (-0.5e-6 if up else 0.5e-6))


# --- effects of other packages ---


class Foreign(Effect):
    name = "a foreign effect"
    sentence = "It comes from another package."
    source = "this test"
    sizes = (Size("size", "m", -1e-6, 1e-6, "of it"),)

    def settings(self, stops):  # noqa: ARG002
        yield {}

    def change(self, setting, sizes, stops):  # noqa: ARG002
        return Change(reading=sizes["size"] * np.ones(len(stops.time)))


def offer(monkeypatch, **objects):
    module = sys.modules[__name__]
    for name, value in objects.items():
        monkeypatch.setattr(module, name, value, raising=False)
    points = [EntryPoint(n, f"{__name__}:{n}", effects.ENTRY_POINTS) for n in objects]
    monkeypatch.setattr(registry, "installed_points", lambda _: points)


def test_another_package_adds_an_effect(monkeypatch):
    offer(monkeypatch, FOREIGN=Foreign())
    assert catalogue()["a foreign effect"].label({}) == "a foreign effect"


@pytest.mark.parametrize("broken", ["text", "nameless", "taken", "absent", "prefix"])
def test_a_broken_effect_of_another_package_is_refused_in_a_sentence(monkeypatch, broken):
    class Nameless(Foreign):
        name = ""

    class Taken(Foreign):
        name = "backlash"

    class Prefixed(Foreign):
        sizes = (Size("size", "um", -1.0, 1.0, "of it"),)

    found = {"text": "no effect", "nameless": Nameless(), "taken": Taken(), "absent": Foreign()}
    found["prefix"] = Prefixed()
    offer(monkeypatch, THE_POINT=found[broken])
    if broken == "absent":
        monkeypatch.delattr(sys.modules[__name__], "THE_POINT")
    why = {
        "text": a_fault("wrong_kind", "Effect"),
        "nameless": a_fault("wrong_kind", "'name'"),
        "taken": a_fault("twice", "backlash"),
        "absent": a_fault("failed", "AttributeError"),
        "prefix": a_fault("wrong_kind", "'um'", "'size'"),
    }
    with refused(Refusal, why[broken]) as caught:
        catalogue()
    assert "THE_POINT" in str(caught.value) and "\n" not in str(caught.value)


class Misspelt(Foreign):
    def change(self, setting, sizes, stops):  # noqa: ARG002
        return Change(reading=sizes["sise"] * np.ones(len(stops.time)))


class WrongAxis(Foreign):
    def change(self, setting, sizes, stops):  # noqa: ARG002
        return Change.along("y", sizes["size"] * stops.time)


class OutOfProportion(Foreign):
    def change(self, setting, sizes, stops):  # noqa: ARG002
        return Change(reading=np.sqrt(np.abs(sizes["size"])) * stops.time)


class InMicrometres(Foreign):
    sizes = (Size("size", "m", -50.0, 50.0, "of it, in µm"),)

    def change(self, setting, sizes, stops):  # noqa: ARG002
        return Change(reading=sizes["size"] * stops.share[:, 0])


class Undeclared(Foreign):
    def settings(self, stops):  # noqa: ARG002
        yield {"axis": "X"}


class Returns(Foreign):
    def settings(self, stops):  # noqa: ARG002
        return {}


class OtherNames(Undeclared):
    keys = (Key("axis", ("Y", "Z")),)


class Broken(Foreign):
    def change(self, setting, sizes, stops):  # noqa: ARG002
        raise ValueError("broken")


class Oblong(Foreign):
    def change(self, setting, sizes, stops):  # noqa: ARG002
        return Change(reading=sizes["size"] * stops.share)


class Flat(Foreign):
    def change(self, setting, sizes, stops):  # noqa: ARG002
        return Change(translation=sizes["size"] * stops.time)


class Short(Foreign):
    def change(self, setting, sizes, stops):  # noqa: ARG002
        return Change(reading=sizes["size"] * stops.time[1:])


class Constant(Foreign):
    def change(self, setting, sizes, stops):  # noqa: ARG002
        return Change(reading=sizes["size"])


class Mat(Foreign):
    def change(self, setting, sizes, stops):  # noqa: ARG002
        return Change.along("Y", sizes["size"] * stops.share)


class TurnsX(Foreign):
    def change(self, setting, sizes, stops):  # noqa: ARG002
        return Change(rotations={"X": sizes["size"] * stops.share})


class Sensed(Foreign):
    def change(self, setting, sizes, stops):  # noqa: ARG002
        return Change(reading=sizes["size"] * stops.last_sense[:, 0])


class Wordless(Foreign):
    def label(self, setting):
        pass


@pytest.mark.parametrize(
    ("effect", "raised"),
    [
        (Broken, ("ValueError",)),
        (Oblong, ("TypeError", "reading", "3")),
        (Flat, ("TypeError", "translation", "3")),
        (Short, ("TypeError", "reading")),
        (Constant, ("TypeError", "reading")),
        (Mat, ("TypeError", "distance", "3")),
        (TurnsX, ("LookupError", "'X'", "0, 1, 2")),
        (Wordless, ("TypeError", "'label'", "None")),
        (Sensed, ("ArithmeticError", "depends_on_sense")),
        (Misspelt, ("KeyError", "'sise'")),
        (WrongAxis, ("LookupError", "'y'", "X, Y, Z")),
        (OutOfProportion, ("ArithmeticError",)),
        (InMicrometres, ("ArithmeticError", "50 m")),
        (Undeclared, ("LookupError", "axis", "none")),
        (OtherNames, ("LookupError", "'X'", "Y, Z")),
        (Returns, ("TypeError", "'settings'")),
    ],
)
def test_an_effect_whose_code_fails_is_named_with_what_it_raises(effect, raised):
    run = simulate(make_plan(blocks=3, repeats=2), make_cell())
    with refused(Refusal, "failed", __name__, *raised, about="a foreign effect"):
        diagnose(run, catalogue=[effect()])


class OfTwoSenses(Foreign):
    depends_on_sense = True

    def change(self, setting, sizes, stops):  # noqa: ARG002
        bend = stops.last_sense[:, 0] * stops.share[:, 1] + stops.last_sense[:, 2]
        return Change.along("Y", sizes["size"] * bend)


@pytest.mark.parametrize(
    ("effect", "setting", "axes"),
    [
        (Backlash(), {"axis": "Y"}, {1}),
        (LearnedShape(), {"acts_on": "Z", "shape": "sense y * z^1"}, {1}),
        (LearnedShape(), {"acts_on": "reading", "shape": "sense z"}, {2}),
        (LearnedShape(), {"acts_on": "Z", "shape": "x^1 * y^1"}, set()),
        (OfTwoSenses(), {}, {0, 2}),
    ],
)
def test_what_an_axis_did_before_its_first_move_in_a_setup_is_free(effect, setting, axes):
    stops = stops_of(simulate(make_plan(blocks=3, repeats=2, orders=("ZXY",)), make_cell()))
    free = effect.unknown(setting, stops)
    told = np.all(stops.last_sense[:, sorted(axes)] != 0.0, axis=1)
    assert not np.any(free[told]) and np.all(np.any(free, axis=0))
    sizes = {size.name: 1.0 for size in effect.sizes}
    senses = np.random.default_rng(1).choice([-1.0, 1.0], (len(stops.setups), 3))[stops.setup]
    came = np.where(stops.last_sense == 0.0, senses, stops.last_sense)
    really = effect.change(setting, sizes, replace(stops, last_sense=came)).readings(stops)
    assumed = effect.change(setting, sizes, stops).readings(stops)
    assert np.any(really != assumed) == bool(axes)
    change = really - assumed
    left = change - free @ np.linalg.lstsq(free, change, rcond=None)[0]
    assert np.max(np.abs(left)) < 1e-12


def test_a_size_that_is_plausible_in_a_small_box_blocks_no_run_in_a_large_one():
    class Grows(Foreign):
        sizes = (Size("size", "1/m^2", -0.2, 0.2, "of it"),)

        def change(self, setting, sizes, stops):  # noqa: ARG002
            return Change(reading=sizes["size"] * stops.position[:, 0] * stops.position[:, 1] ** 2)

    cell = make_cell(high=(1.0, 1.0, 1.0))
    run = simulate(make_plan(blocks=4, step=(0.25, 0.25, 0.25), repeats=2), cell)
    assert "a foreign effect" in diagnose(run, catalogue=[Grows()]).detection_limits


def test_a_cell_with_an_effect_whose_code_fails_is_refused_by_the_name_of_the_effect():
    active = ActiveEffect(WrongAxis(), {}, {"size": 1e-6})
    with refused(Refusal, "failed", "LookupError", "'y'", about="a foreign effect"):
        LiveEffects(make_plan(blocks=3), replace(make_cell(), effects=(active,)))


OWN_EFFECT = """\
from stepdiag_ros.metrology.effects.backlash import Backlash
from stepdiag_ros.metrology.effects.effect import Change, Effect, Size

class Bow(Effect):
    name = "bow"
    sentence = "A guideway bends."
    source = "this test"
    sizes = (Size("height", "m", -1e-5, 1e-5, "in the middle"),)

    def settings(self, stops):
        yield {}

    def change(self, setting, sizes, stops):
        return Change.along("Z", sizes["height"] * stops.time)

EFFECT = Bow()
"""


@pytest.mark.parametrize(
    ("right", "wrong", "fault"),
    [
        ('name = "bow"', 'name = "backlash"', a_fault("twice", "backlash")),
        ('source = "this test"', "", a_fault("wrong_kind", "'source'")),
        ("sizes = (Size", "unused = (Size", a_fault("wrong_kind", "'sizes'")),
        ('middle"),)', 'middle"))', a_fault("wrong_kind", "'sizes'", "Size")),
        ("-1e-5, 1e-5", "1e-5, -1e-5", a_fault("wrong_kind", "'height'", "1e-05")),
        ("EFFECT = Bow()", "EFFECT = Bow", a_fault("wrong_kind", "Effect")),
        ("EFFECT = Bow()", "EFECT = Bow()", a_fault("missing", about="EFFECT")),
        ("EFFECT = Bow()", "EFFECT = {}['bow']", a_fault("failed", "KeyError")),
        ("EFFECT = Bow()", "import bow_of_nothing", a_fault("failed", "bow_of_nothing")),
        ("", "", None),
    ],
)
def test_a_module_of_this_package_is_checked_like_that_of_another(
    tmp_path, monkeypatch, right, wrong, fault
):
    (tmp_path / "test_bow.py").write_text(OWN_EFFECT.replace(right, wrong))
    monkeypatch.setattr(effects, "__path__", [*effects.__path__, str(tmp_path)])
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    module = "stepdiag_ros.metrology.effects.test_bow"
    monkeypatch.delitem(sys.modules, module, raising=False)
    try:
        if fault is None:
            assert catalogue()["bow"].sentence == "A guideway bends."
        else:
            with refused(Refusal, fault, module):
                catalogue()
    finally:
        sys.modules.pop(module, None)
