import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from cells_for_tests import make_cell, make_plan
from refused import a_fault, refused

from stepdiag_ros.metrology.cell import SimulatedCell
from stepdiag_ros.metrology.forward import perpendiculars, tilted
from stepdiag_ros.metrology.geometry import (
    AXES,
    CHAINS,
    CURVES,
    ROTATIONS,
    TRANSLATIONS,
    beam_direction,
)
from stepdiag_ros.metrology.machine import Machine
from stepdiag_ros.metrology.plan import Volume
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.resources import directory

STEP = (0.01, 0.01, 0.01)
VOLUME = Volume((0.0, 0.0, 0.0), STEP, 6)


@pytest.mark.parametrize("name", ["demo", "angular"])
def test_shipped_cells_can_be_read(name):
    text = (directory("config") / "cells" / f"{name}.yaml").read_text()
    cell = SimulatedCell.from_mapping(yaml.safe_load(text), name)
    assert cell.chain == "YXZ"
    assert cell.errors.turns == (name == "angular")
    truth = cell.truth(Volume((0.0, 0.0, 0.0), STEP, 12))
    assert list(truth) == list(CURVES)
    for name in TRANSLATIONS:
        # Levers of the rotations are in the translations of the mirror's point.
        assert 0.05e-6 < np.ptp(truth[name]) < (30e-6 if cell.errors.turns else 8e-6)
    for name in ROTATIONS:
        assert (1e-6 < np.ptp(truth[name]) < 100e-6) == cell.errors.turns
        assert cell.errors.turns or not np.any(truth[name])


def test_shipped_machine_can_be_read_and_holds_the_shipped_cell():
    text = (directory("config") / "machines" / "demo.yaml").read_text()
    machine = Machine.from_mapping(yaml.safe_load(text), "demo")
    assert machine.chain == "YXZ"
    assert all(high >= 0.12 for high in machine.travel_high_m)
    assert machine.position_window_m == 0.5e-6


def machine_mapping(**changed):
    return {
        "chain": "XYZ",
        "travel_low_m": [0, 0, 0],
        "travel_high_m": [1, 1, 1],
        "feed_limit_m_per_s": 0.5,
        "acceleration_m_per_s2": 2,
        **changed,
    }


def test_every_chain_is_a_machine():
    for chain in CHAINS:
        assert Machine.from_mapping(machine_mapping(chain=chain), "m").chain == chain


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"chain": "XYY"}, a_fault("unknown", about="chain")),
        ({"travel_low_m": [0, 2, 0]}, a_fault("mismatch", "travel_low_m", "Y", aspect="travel")),
        (
            {"feed_limit_m_per_s": 0},
            a_fault("out_of_range", about="feed_limit_m_per_s"),
        ),
        # Meant in m/min: the refusal gives both units, and what to write.
        (
            {"feed_limit_m_per_s": 6},
            a_fault("out_of_range", "360", "0.1", about="feed_limit_m_per_s"),
        ),
        ({"feedlimit": 1}, a_fault("unknown", about="feedlimit")),
        (
            {"travel_high_m": [1, 1]},
            a_fault("malformed", about="travel_high_m"),
        ),
    ],
)
def test_wrong_machines_are_refused(changed, words):
    with refused(Refusal, words):
        Machine.from_mapping(machine_mapping(**changed), "m")


def test_truth_starts_at_zero_in_the_frame_and_has_the_given_squareness():
    flat = make_cell(chain="XYZ", size=0.0, squareness=(30e-6, -20e-6, 25e-6), held=0.0)
    truth = flat.truth(VOLUME)
    slope = {name: curve[-1] / 0.06 for name, curve in truth.items()}
    # right-handed rotation of Y about Z: x falls; of Z about Y: x rises; of Z about X: y falls,
    # which the frame turns into Y's rise.
    assert slope["E_XY"] == pytest.approx(-30e-6)
    assert slope["E_XZ"] == pytest.approx(-20e-6)
    assert slope["E_ZY"] == pytest.approx(-25e-6)
    assert slope["E_YX"] == slope["E_ZX"] == slope["E_YZ"] == 0.0
    for curve in make_cell().truth(VOLUME).values():
        assert curve[0] == 0.0


def test_given_curves_are_taken_as_they_are():
    nodes = {axis: [0.0, 0.03, 0.06] for axis in AXES}
    cell = SimulatedCell.from_mapping(
        {
            "chain": "XYZ",
            "errors": {"nodes_m": nodes, "curves": {"E_XX": [1e-6, 3e-6, 2e-6]}},
        },
        "given",
    )
    truth = cell.truth(Volume((0.0, 0.0, 0.0), (0.03, 0.03, 0.03), 2))
    assert truth["E_XX"] == pytest.approx([0.0, 2e-6, 1e-6], abs=1e-20)
    assert not any(np.any(truth[name]) for name in TRANSLATIONS if name != "E_XX")


def test_misalignment_depends_on_seed_and_setup_alone_in_every_process():
    code = (
        "import sys; sys.path.insert(0, sys.argv[1])\n"
        "from cells_for_tests import make_cell\n"
        "print(make_cell(seed=9).misalignment.angles('ppp XYZ', 'ppp', 9))"
    )
    here = str(Path(__file__).parents[1])
    printed = {
        subprocess.run(
            [sys.executable, "-c", code, here],
            env={**os.environ, "PYTHONHASHSEED": seed},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for seed in ("1", "2")
    }
    own = make_cell(seed=9).misalignment.angles("ppp XYZ", "ppp", 9)
    assert printed == {f"{own}\n"}
    assert own != make_cell(seed=9).misalignment.angles("ppp YZX", "ppp", 9)
    assert own != make_cell(seed=8).misalignment.angles("ppp XYZ", "ppp", 8)


def test_random_misalignment_has_the_given_size():
    cell = make_cell(tilt=1e-4, mirror=2e-5)
    angles = np.array([cell.misalignment.angles(f"setup {i}", "ppp", 1) for i in range(400)])
    assert np.std(angles, axis=0) == pytest.approx([1e-4, 1e-4, 2e-5, 2e-5], rel=0.15)


def test_explicit_misalignment_counts_the_mirror_from_the_beam():
    cell = make_cell(lines={"ppp": [1e-4, 2e-4, 3e-5, -4e-5]})
    alignment = cell.alignment("ppp XYZ", "ppp", STEP)
    nominal = beam_direction("ppp", np.array(STEP))
    one, two = perpendiculars(nominal)
    assert alignment.beam @ np.array([one, two]).T == pytest.approx([1e-4, 2e-4])
    expected = tilted(nominal, (1.3e-4, 1.6e-4))
    assert alignment.mirror_normal == pytest.approx(expected, abs=1e-15)


def test_displacement_of_a_perfect_cell_is_the_way_along_the_beam():
    cell = make_cell(tilt=0.0, squareness=(0, 0, 0), size=0.0)
    start = (0.06, 0.0, 0.0)
    alignment = cell.alignment("npp XYZ", "npp", STEP, start)
    positions = np.array([start, (0.05, 0.01, 0.01), (0.0, 0.06, 0.06)])
    way = cell.displacement(positions, alignment)
    assert way == pytest.approx(0.3 + np.array([0.0, 0.01, 0.06]) * np.sqrt(3), abs=1e-15)


def test_weather_drifts_and_waves():
    mapping = {
        "chain": "XYZ",
        "errors": {"travel_low_m": [0, 0, 0], "travel_high_m": [1, 1, 1]},
        "weather": {
            "air_temperature_degC": 20.0,
            "air_temperature_drift_K_per_h": 0.5,
            "air_temperature_wave_K": 0.2,
            "wave_period_s": 400.0,
            "air_pressure_Pa": 1e5,
            "air_pressure_drift_Pa_per_h": -36.0,
            "material_temperature_drift_K_per_h": 1.0,
            "material_temperature_wave_K": 0.1,
            "material_warm_up_K": 3.0,
            "warm_up_time_s": 50.0,
        },
    }
    weather = SimulatedCell.from_mapping(mapping, "c").environment(100.0)
    assert weather.air_temperature == pytest.approx(20.0 + 0.5 * 100 / 3600 + 0.2)
    assert weather.air_pressure == pytest.approx(1e5 - 1.0)
    wave, warm = 0.1 * np.sqrt(0.5), 3.0 * (1.0 - np.exp(-2.0))
    assert weather.material_temperature == pytest.approx(20.0 + 100 / 3600 + wave + warm)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"chain": "ABC"}, a_fault("unknown", about="chain")),
        ({"errors": {"curves": {"E_XX": [0, 0]}}}, a_fault("missing", "nodes_m", about="X")),
        (
            {
                "errors": {
                    "travel_low_m": [0, 0, 0],
                    "travel_high_m": [0, 1, 1],
                }
            },
            a_fault("mismatch", "travel_low_m", aspect="travel"),
        ),
        ({"misalignment": {"lines": {"qqq": [0, 0, 0, 0]}}}, a_fault("unknown", "qqq")),
        ({"misalignment": {"lines": {"ppp": [0, 0]}}}, a_fault("malformed", "4", about="ppp")),
        ({"drive": {"lag": 0.1}}, a_fault("unknown", about="lag")),
        (
            {"weather": {"relative_humidity": 45}},
            a_fault("out_of_range", about="relative_humidity"),
        ),
        ({"seed": -1}, a_fault("out_of_range", about="seed")),
    ],
)
def test_wrong_cells_are_refused(changed, words):
    mapping = {
        "chain": "XYZ",
        "errors": {"travel_low_m": [0, 0, 0], "travel_high_m": [1, 1, 1]},
        **changed,
    }
    with refused(Refusal, words):
        SimulatedCell.from_mapping(mapping, "c")


def test_too_few_values_name_the_curve():
    nodes = {axis: [0.0, 1.0] for axis in AXES}
    errors = {"nodes_m": nodes, "curves": {"E_ZY": [0.0]}}
    with refused(Refusal, "mismatch", "E_ZY", "1", "2", "Y"):
        SimulatedCell.from_mapping({"chain": "XYZ", "errors": errors}, "c")


def test_nothing_is_measured_or_true_beyond_the_curves():
    """The curves are held beyond their ends, but neither a stop nor a truth is taken from there."""
    cell = make_cell(high=(0.06, 0.06, 0.06), held=0.0)
    larger = Volume((0.0, 0.0, 0.0), (0.01, 0.011, 0.01), 6)
    with refused(Refusal, "out_of_range", "Y", "66"):
        cell.truth(larger)
    plan = make_plan(step=larger.step)
    with refused(Refusal, "out_of_range", "Y", "66", "0", "60"):
        simulate(plan, cell)
    assert simulate(make_plan(step=larger.step), make_cell(held=0.01)).lines


def test_a_run_up_beyond_the_curves_is_no_measurement():
    """It is passed on the way to the first stop, over which the curves are held."""
    cell = make_cell(held=0.0)
    plan = replace(make_plan(), overrun=2e-3)
    assert np.min(plan.run_up(plan.lines[0])) < 0.0
    assert simulate(plan, cell).lines
    np.testing.assert_array_equal(
        cell.errors.at(0, np.array([-2e-3, 0.062])), cell.errors.at(0, np.array([0.0, 0.06]))
    )


def test_places_of_another_axis_or_within_rounding_are_inside():
    errors = make_cell(high=(0.06, 0.05, 0.04), held=0.0).errors
    assert errors.outside(np.array([[0.06, 0.05, 0.04 + 1e-9], [0.0, 0.0, 0.0]])) == ""
    assert "Z = 41 mm" in errors.outside(np.array([[0.06, 0.05, 0.041]]))
    assert "X = -1 mm" in errors.outside(np.array([[-0.001, 0.05, 0.04]]))
