"""ISO 230-2: a published evaluation, the definitions on small data, and what must not matter."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from refused import a_fault, refused

from stepdiag_ros.metrology.plan import LINEAR
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.standards.axis_test import BidirectionalRuns
from stepdiag_ros.metrology.standards.iso230_2 import PARAMETERS, evaluate
from stepdiag_ros.metrology.standards.positioning_uncertainty import (
    UncertaintyDescription,
    contributions,
    expanded_uncertainties,
)

CASE = Path(__file__).parent.parent / "data" / "cases" / "iso230_2_measured"

CONDITIONS = UncertaintyDescription(
    device=1e-6,
    misalignment=1e-3,
    temperature_range=0.5,
    expansion_coefficient=12e-6,
    expansion_range=2e-6,
    temperature_difference=-3.0,
    environmental_variation=0.6e-6,
)


def runs(forward, backward, name="X"):
    forward, backward = np.array(forward, dtype=float), np.array(backward, dtype=float)
    count = forward.shape[1] if forward.size else backward.shape[1]
    empty = np.empty((0, count))
    return BidirectionalRuns(
        name,
        LINEAR,
        np.arange(count) * 0.1,
        forward if forward.size else empty,
        backward if backward.size else empty,
    )


def measured_runs():
    """Read the real data without the package's reader."""
    with (CASE / "data.csv").open(newline="") as table:
        rows = list(csv.DictReader(table))
    deviations = {
        (row["direction"], int(row["cycle"]), float(row["target_mm"])): (
            float(row["position_mm"]) - float(row["target_mm"])
        )
        * 1e-3
        for row in rows
    }
    targets = sorted({key[2] for key in deviations})
    forward, backward = (
        np.array([[deviations[direction, cycle, t] for t in targets] for cycle in range(1, 6)])
        for direction in ("forward", "backward")
    )
    return BidirectionalRuns("X", LINEAR, np.array(targets) * 1e-3, forward, backward)


def test_real_data_give_the_published_figures_but_the_two_that_depart_from_the_standard():
    found = evaluate(measured_runs()).parameters
    published = yaml.safe_load((CASE / "published.yaml").read_text())["parameters"]
    by_the_standard = {**published, "R": 6.882e-05, "E": 3.68e-05}
    assert set(by_the_standard) == set(PARAMETERS)
    for name, value in by_the_standard.items():
        # Every figure is printed to four digits at the most.
        assert found[name] * 1e3 == pytest.approx(value, abs=0.5001e-8), name
    assert {name for name in published if abs(found[name] * 1e3 - published[name]) > 1e-8} == {
        "R",
        "E",
    }


def test_the_r_of_the_real_data_is_the_largest_of_its_own_column():
    test = evaluate(measured_runs())
    assert test.parameters["R"] == max(test.repeatability)
    means = np.concatenate([test.mean_forward, test.mean_backward])
    assert test.parameters["E"] == np.ptp(means)


def test_the_definitions_by_hand():
    # Means 0 and 10 forward, 2 and 4 backward; s: √2 and 0 forward, 0 and 3√2 backward.
    test = evaluate(runs([[-1, 10], [1, 10]], [[2, 1], [2, 7]]))
    root = np.sqrt(2.0)
    np.testing.assert_allclose(test.reversal, [-2, 6])
    np.testing.assert_allclose(test.deviation_forward, [root, 0])
    np.testing.assert_allclose(test.deviation_backward, [0, 3 * root])
    # At the first target R↑ = 4√2 is larger than 2√2 + 2; at the second R↓ = 12√2 > 6√2 + 6.
    np.testing.assert_allclose(test.repeatability, [4 * root, 12 * root])
    expected = {
        "A": max(10, 4 + 6 * root) - min(-2 * root, 4 - 6 * root),
        "A↑": 10 + 2 * root,
        "A↓": (4 + 6 * root) - (4 - 6 * root),
        "R": 12 * root,
        "R↑": 4 * root,
        "R↓": 12 * root,
        "E": 10,
        "E↑": 10,
        "E↓": 2,
        "M": 6,
        "B": 6,
        "mean B": 2,
    }
    for name, value in expected.items():
        assert test.parameters[name] == pytest.approx(value), name


def test_r_takes_the_sum_where_the_reversal_is_large():
    test = evaluate(runs([[0, 0], [2, 2]], [[50, 0], [52, 2]]))
    root = np.sqrt(2.0)
    np.testing.assert_allclose(test.repeatability, [4 * root + 50, 4 * root])


deviation = st.floats(-1e-4, 1e-4)


@st.composite
def any_runs(draw):
    n, m = draw(st.integers(2, 5)), draw(st.integers(2, 6))
    values = draw(st.lists(deviation, min_size=2 * n * m, max_size=2 * n * m))
    table = np.array(values).reshape(2, n, m)
    return runs(table[0], table[1])


@settings(max_examples=40)
@given(any_runs(), st.randoms(use_true_random=False), st.floats(0.01, 100), st.floats(-1, 1))
def test_order_of_runs_zero_and_scale(one, random, scale, shift):
    base = evaluate(one).parameters

    def again(forward, backward):
        return evaluate(
            BidirectionalRuns(one.name, one.kind, one.target, forward, backward)
        ).parameters

    order = list(range(len(one.forward)))
    random.shuffle(order)
    permuted = again(one.forward[order], one.backward[order[::-1]])
    shifted = again(one.forward + shift, one.backward + shift)
    scaled = again(one.forward * scale, one.backward * scale)
    swapped = again(one.backward, one.forward)
    for name, value in base.items():
        assert permuted[name] == pytest.approx(value, abs=1e-15), name
        assert shifted[name] == pytest.approx(value, abs=1e-12), name
        assert scaled[name] == pytest.approx(value * scale, rel=1e-9, abs=1e-15), name
        other = name.translate(str.maketrans("↑↓", "↓↑"))
        assert swapped[other] == pytest.approx(-value if name == "mean B" else value), name


@settings(max_examples=40)
@given(any_runs())
def test_the_parameters_keep_their_order(one):
    found = evaluate(one).parameters
    tiny = 1e-15
    assert found["A"] >= max(found["A↑"], found["A↓"]) - tiny
    assert found["E"] >= max(found["E↑"], found["E↓"], found["M"], found["B"]) - tiny
    assert found["R"] >= max(found["R↑"], found["R↓"], found["B"]) - tiny
    assert found["A"] >= max(found["E"], found["R"]) - tiny
    assert abs(found["mean B"]) <= found["B"] + tiny


def test_a_single_run_tells_no_repeatability():
    test = evaluate(runs([[0, 1e-6]], [[2e-6, 1e-6]]), CONDITIONS)
    unknown = {"A", "A↑", "A↓", "R", "R↑", "R↓"}
    assert {name for name, value in test.parameters.items() if np.isnan(value)} == unknown
    assert {n for n, value in test.expanded_uncertainty.items() if np.isnan(value)} == unknown
    assert any("a single run" in remark for remark in test.remarks)


def test_runs_in_one_direction_tell_nothing_bidirectional():
    test = evaluate(runs([[0, 1e-6], [0, 2e-6]], []))
    known = {"A↑", "R↑", "E↑"}
    assert {name for name, value in test.parameters.items() if np.isfinite(value)} == known
    assert any("no backward run" in remark for remark in test.remarks)


def test_fewer_runs_than_five_are_said():
    remarks = evaluate(runs([[0, 1], [0, 2]], [[0, 1], [0, 2]])).remarks
    assert "2 forward and 2 backward runs; the standards ask for 5 each" in remarks
    assert not evaluate(measured_runs()).remarks


def test_the_contributions_are_those_of_the_annex():
    # ISO 230-2 annex A prints 0.6 for 2/(2√3) and 0.3 for half of it: here to their rounding.
    found = contributions(CONDITIONS, 0.5)
    assert found.device == pytest.approx(0.5e-6)
    assert found.misalignment == pytest.approx(0.3 * 1e-3**2 / 0.5, rel=0.05)
    assert found.temperature == pytest.approx(0.6 * 12e-6 * 0.5 * 0.5, rel=0.05)
    assert found.expansion == pytest.approx(0.6 * 3.0 * 0.5 * 2e-6, rel=0.05)
    assert found.environment == pytest.approx(0.6 * 0.6e-6, rel=0.05)


@pytest.mark.parametrize(
    "conditions",
    [CONDITIONS, replace(CONDITIONS, environmental_variation=6e-6)],
    ids=["length decides", "environment decides"],
)
def test_the_uncertainty_is_that_of_a_simulation_of_its_contributions(conditions):
    """Draw every contribution as described; the parameters then spread by U/2 (k = 2)."""
    rng = np.random.default_rng(5)
    n, target, draws = 5, np.linspace(0, 0.5, 6), 4000
    length = target[-1]
    # A machine with a slope, so that E and M are decided by the ends, and a large reversal at one.
    form = np.array([0.0, 10, 20, 30, 40, 50]) * 10e-6
    back = form + np.array([0, 0, 0, 9, 0, 0]) * 10e-6
    values = {"E↑": [], "M": [], "B": [], "mean B": []}
    for _ in range(draws):
        uniform = rng.uniform(-0.5, 0.5, 3)
        scale = (
            rng.normal(0, 0.5) * conditions.device
            + uniform[0] * conditions.misalignment**2 / (2 * length**2)
            + uniform[1] * conditions.expansion_coefficient * conditions.temperature_range
            + uniform[2] * conditions.temperature_difference * conditions.expansion_range
        )
        eve = conditions.environmental_variation * rng.uniform(-0.5, 0.5, (2, n, 6))
        one = BidirectionalRuns(
            "X", LINEAR, target, form + scale * target + eve[0], back + scale * target + eve[1]
        )
        found = evaluate(one).parameters
        for name in ("E↑", "M", "B"):
            values[name].append(found[name])
        # A zero that wanders from run to run is the same at all targets of a run.
        wander = conditions.environmental_variation * rng.uniform(-0.5, 0.5, (2, n, 1))
        runs = BidirectionalRuns("X", LINEAR, target, form + wander[0], back + wander[1])
        values["mean B"].append(evaluate(runs).parameters["mean B"])
    expected = expanded_uncertainties(conditions, length, n)
    for name, drawn in values.items():
        assert 2 * np.std(drawn) == pytest.approx(expected[name], rel=0.06), name


def test_an_unknown_input_makes_only_what_needs_it_unknown():
    without_eve = UncertaintyDescription(1e-6, 1e-3, 0.5, 12e-6, 2e-6, -3.0)
    assert all(np.isnan(list(expanded_uncertainties(without_eve, 0.5, 5).values())))
    only_eve = UncertaintyDescription(environmental_variation=0.6e-6)
    found = expanded_uncertainties(only_eve, 0.5, 5)
    assert {name for name, value in found.items() if np.isfinite(value)} == {
        "B",
        "mean B",
        "R",
        "R↑",
        "R↓",
    }
    assert "device" in only_eve.unknown()
    assert "environmental variation" not in only_eve.unknown()


def test_a_description_is_read_with_unknowns_and_refuses_what_it_does_not_know():
    found = UncertaintyDescription.from_mapping({"misalignment_m": 1e-3}, "file")
    assert found.misalignment == 1e-3
    assert np.isnan(found.device)
    with refused(Refusal, "unknown", about="misalignement_m"):
        UncertaintyDescription.from_mapping({"misalignement_m": 1e-3}, "file")
    with refused(Refusal, "out_of_range", "0.5", about="device_U_m_per_m"):
        UncertaintyDescription.from_mapping({"device_U_m_per_m": 0.5}, "file")


@pytest.mark.parametrize(
    ("target", "forward", "backward", "message"),
    [
        ([0.0], [[0.0]], [[0.0]], a_fault("out_of_order")),
        ([0.0, 0.0], [[0, 0]], [[0, 0]], a_fault("out_of_order")),
        ([0.0, 1.0], [[0, 0, 0]], [[0, 0]], a_fault("mismatch")),
        ([0.0, 1.0], [[0, np.nan]], [[0, 0]], a_fault("out_of_range", aspect="deviation")),
        ([0.0, 1.0], np.empty((0, 2)), np.empty((0, 2)), a_fault("too_few")),
    ],
)
def test_runs_that_contradict_themselves_are_refused(target, forward, backward, message):
    with refused(Refusal, message):
        BidirectionalRuns(
            "X", LINEAR, np.array(target), np.array(forward, float), np.array(backward, float)
        )
