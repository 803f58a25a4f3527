"""The proof on held-out readings, against the prediction's covariance written out in full."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from stepdiag_ros.metrology.discrepancy.baseline import SECOND_ORDER_SCALE, fit_baseline
from stepdiag_ros.metrology.discrepancy.findings import NAMED, Candidate, Loose
from stepdiag_ros.metrology.discrepancy.held_out import _Problem, _splits, prove
from stepdiag_ros.metrology.effects.backlash import EFFECT
from stepdiag_ros.metrology.effects.effect import ActiveEffect
from stepdiag_ros.metrology.effects.stops import stops_of
from stepdiag_ros.metrology.measurement import MeasuredLine, Measurement
from stepdiag_ros.metrology.plan import Line, Volume

NOISE, RHO, SIZE = 1e-7, 0.3, 8e-7
VOLUME = Volume((0.0, 0.0, 0.0), (0.03, 0.02, 0.01), 4)
X = Candidate(EFFECT, {"axis": "X"}, "backlash of X")


def _measurement(repeats=2, seed=1):
    rng = np.random.default_rng(seed)
    lines, time = [], 0.0
    names = [("linear", "x", ""), ("linear", "y", ""), ("linear", "z", "")]
    names += [("step_diagonal", name, "XYZ") for name in ("ppp", "npp", "pnp", "ppn")]
    for kind, name, order in names:
        for repeat in range(repeats):
            for direction in ("forward", "backward"):
                line = Line(kind, name, order, repeat, direction, (0.0, 0.0, 0.0))
                target = line.stops(VOLUME)
                count = len(target)
                noise = rng.standard_normal(count)
                for row in range(1, count):
                    noise[row] = RHO * noise[row - 1] + np.sqrt(1 - RHO**2) * noise[row]
                lines.append(
                    MeasuredLine(
                        line,
                        len(lines),
                        1,
                        name,
                        time + np.arange(count),
                        0,
                        target,
                        NOISE * noise,
                        np.full(count, NOISE),
                        np.full((count, 4), 20.0),
                    )
                )
                time += 100.0
    bare = Measurement(VOLUME, tuple(lines), "YXZ")
    stops = stops_of(bare)
    way = np.sum(stops.direction * (stops.position - stops.start), axis=1)
    added = way + ActiveEffect(EFFECT, {"axis": "X"}, {"lost_motion": SIZE}).readings(stops)
    parts = np.split(added, np.cumsum([len(line.time) for line in lines])[:-1])
    read = [
        replace(line, displacement=line.displacement + part)
        for line, part in zip(lines, parts, strict=True)
    ]
    return replace(bare, lines=tuple(read))


def _diagnosis(stops, candidates=(X,), verdict=NAMED):
    """Stand in for a diagnosis: what the proof takes from one."""
    return SimpleNamespace(
        findings=tuple(SimpleNamespace(candidate=one) for one in candidates),
        verdict=verdict,
        noise=NOISE,
        noise_degrees_of_freedom=np.inf,
        noise_correlation=RHO,
        stops=stops,
        loose=Loose(),
    )


@pytest.fixture(scope="module")
def run():
    measurement = _measurement()
    stops = stops_of(measurement)
    return measurement, stops, fit_baseline(measurement, stops)


def _explicitly(baseline, stops, held, columns):
    """χ² of a prediction: r' V⁻¹ r, V the noise and the fit's uncertainty, nothing factored."""
    free = np.column_stack([baseline.matrix, baseline.loose, columns])
    # The prior of the scales, and none to speak of for the rest.
    size = 1e3 / np.maximum(np.linalg.norm(free, axis=0), 1e-30) * 1e-6
    count = baseline.matrix.shape[1]
    size[count : count + baseline.loose.shape[1]] = SECOND_ORDER_SCALE
    apart = np.abs(stops.number[:, None] - stops.number)
    same = stops.pass_index[:, None] == stops.pass_index
    noise = np.where(same, NOISE**2 * RHO**apart, 0.0)
    whole = noise + (free * size**2) @ free.T
    a, b = ~held, held
    gain = np.linalg.solve(whole[np.ix_(a, a)], whole[np.ix_(a, b)]).T
    left = baseline.gap[b] - gain @ baseline.gap[a]
    spread = whole[np.ix_(b, b)] - gain @ whole[np.ix_(a, b)]
    return float(left @ np.linalg.solve(spread, left)), left


@pytest.mark.parametrize("split", [0, 1, 2])
def test_the_chi_squared_is_that_of_the_whole_covariance(run, split):
    _, stops, baseline = run
    held = list(_splits(stops))[split][1]
    columns = EFFECT.columns({"axis": "X"}, stops)
    problem = _Problem(baseline, _diagnosis(stops))
    for tried in (columns[:, :0], columns):
        found = problem.predict(held, tried)
        expected, left = _explicitly(baseline, stops, held, tried)
        assert found.chi_squared == pytest.approx(expected, rel=2e-3)
        assert found.degrees_of_freedom == np.count_nonzero(held)
        if split < 2:
            # Noise has no memory from pass to pass: the residual is that of the prediction.
            assert np.max(np.abs(found.residual[held] - left)) < 1e-3 * NOISE


def test_what_no_reading_shows_does_not_keep_a_split_from_being_a_proof(run):
    _, stops, baseline = run
    problem = _Problem(baseline, _diagnosis(stops))
    shown = EFFECT.columns({"axis": "X"}, stops)[baseline.good]
    # The baseline follows these entirely: what is left of them is rounding.
    weights = np.random.default_rng(1).standard_normal((baseline.matrix.shape[1], 40))
    unseen = baseline.matrix @ weights
    for _, held in list(_splits(stops))[:2]:
        assert problem.both_tell(shown, held)
        assert problem.both_tell(np.column_stack([shown, unseen]), held)
        assert not problem.both_tell(unseen, held)


def test_the_effect_predicts_what_it_has_not_seen(run):
    measurement, stops, baseline = run
    asked = []

    def trained(part):
        asked.append(np.concatenate([line.displacement for line in part.lines]))
        return _diagnosis(stops)

    proof = prove(measurement, _diagnosis(stops), baseline, trained)
    assert proof.independent and proof.labels == ("backlash of X",)
    # What was held out was not shown, and everything else was.
    held = np.isnan(asked[0])
    assert np.array_equal(held, np.isfinite(proof.after.residual))
    assert set(np.array([line.repeat for line in stops.lines])[stops.pass_index[held]]) == {1}
    assert np.count_nonzero(held) == proof.readings == len(held) // 2
    assert proof.before.reduced > 2.0 and proof.before.p_value < 1e-6
    assert 0.75 < proof.after.reduced < 1.25 and proof.after.p_value > 0.001
    assert np.nanstd(proof.after.residual) < 1.6 * NOISE < np.nanstd(proof.before.residual)


def test_the_right_model_predicts_to_within_the_noise():
    reduced = []
    for seed in range(20):
        measurement = _measurement(seed=100 + seed)
        stops = stops_of(measurement)
        problem = _Problem(fit_baseline(measurement, stops), _diagnosis(stops))
        held = next(_splits(stops))[1]
        found = problem.predict(held, EFFECT.columns({"axis": "X"}, stops))
        reduced.append(found.chi_squared / found.degrees_of_freedom)
    freedom = 20 * found.degrees_of_freedom
    assert np.mean(reduced) == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / freedom))


def test_another_name_in_training_is_said_so_and_other_splits_are_tried(run):
    measurement, stops, baseline = run
    other = Candidate(EFFECT, {"axis": "Z"}, "backlash of Z")
    calls = []

    def trained(part):
        calls.append(part)
        return _diagnosis(stops, (other,))

    proof = prove(measurement, _diagnosis(stops), baseline, trained)
    assert not proof.independent and proof.labels == ("backlash of X",)
    assert len(calls) == len(list(_splits(stops))) == 3
    assert "only the sizes are theirs" in proof.sentence


def test_nothing_found_needs_no_proof(run):
    measurement, stops, baseline = run
    assert prove(measurement, _diagnosis(stops, ()), baseline, lambda part: part) is None


def test_without_repeats_stops_are_held_out():
    stops = stops_of(_measurement(repeats=1))
    ((words, held),) = _splits(stops)
    assert words == "every third stop of every pass"
    assert set(stops.number[held] % 3) == {2}
