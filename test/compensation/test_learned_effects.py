"""A geometric effect without a name: described, learned, compensated, and gone in the next run.

The machine bends in one quadrant. The bend is computed here by hand, is added to what the laser
reads, and is in the true error of the volume, by which a compensation is judged.
"""

import json
from dataclasses import replace

import numpy as np
import pytest
import standard_runs
import yaml
from refused import refused

from stepdiag_ros import cli
from stepdiag_ros.compensation import control
from stepdiag_ros.compensation.generic import MAP, correction_from_file, map_from_text
from stepdiag_ros.compensation.nc_division import Division
from stepdiag_ros.compensation.nc_motion import LINE, Motion
from stepdiag_ros.configuration import load_machine, load_model, plan_from_text
from stepdiag_ros.evaluation.compensation import Learned
from stepdiag_ros.metrology.discrepancy import CONSISTENT
from stepdiag_ros.metrology.effects.stops import stops_of
from stepdiag_ros.metrology.forward import tool_point
from stepdiag_ros.metrology.geometry import places_of
from stepdiag_ros.metrology.learned_displacement import LearnedDisplacement, displacements
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.simulation import planned_run, read_again
from stepdiag_ros.run.target_correction import TargetCorrection

pytestmark = pytest.mark.usefixtures("kept_results")

PLAN = """\
name: bend
step_m: [0.02, 0.02, 0.02]
origin_m: [0.01, 0.0, 0.02]
blocks: 6
repeats: 2
directions: [forward, backward]
overrun_m: 0.002
feed_m_per_s: 0.05
lines:
  - {kind: step_diagonal, names: [ppp, npp, pnp, ppn], orders: [XYZ, YZX]}
  - {kind: linear, names: [x, y, z]}
"""
LOW, HIGH = np.array([0.01, 0.0, 0.02]), np.array([0.13, 0.12, 0.14])
NODES = places_of([np.linspace(LOW[axis], HIGH[axis], 7) for axis in range(3)])
NOISE = 0.05e-6
SIZE = 4e-6
CELL = standard_runs.cell(high=(0.15, 0.15, 0.16), held=0.1, noise=NOISE)


def bend(places):
    """Return the displacement of the tool where X and Z are both beyond the middle, m, (n, 3)."""
    x, z = ((2.0 * places[:, axis] - LOW[axis] - HIGH[axis]) / 0.12 for axis in (0, 2))
    moved = np.zeros_like(places)
    moved[:, 1] = SIZE * np.maximum(x, 0.0) * np.maximum(z, 0.0)
    return moved


def sent_by(correction: TargetCorrection | None, places):
    if correction is None:
        return places
    return np.array([correction.sent(tuple(place)) for place in places])


def measured(folder, name, correction=None, added=None, plan_text=PLAN, seed=1):
    """Measure the bent machine, its targets corrected by a map; return the bag."""
    plan = plan_from_text(plan_text, "plan")
    planned = planned_run(plan, CELL)
    sent = tuple(replace(line, target=sent_by(correction, line.target)) for line in planned.lines)
    run = read_again(replace(planned, lines=sent), CELL, NOISE, seed)
    stops = stops_of(planned)
    change = np.sum(
        stops.direction * bend(np.concatenate([line.target for line in run.lines])), axis=1
    )
    if added is not None:
        change = change + added(stops)
    parts = np.split(change, np.cumsum([len(line.time) for line in run.lines])[:-1])
    told = tuple(
        replace(line, target=first.target, displacement=line.displacement + part)
        for line, first, part in zip(run.lines, planned.lines, parts, strict=True)
    )
    messages = [standard_runs.message_of(line) for line in told]
    path = folder / f"{name}.mcap"
    return standard_runs.write_messages(path, messages, plan_text, load_machine("demo")[1], name)


def volume(correction=None):
    """Return the rms true error at the nodes, turned and shifted as a workpiece may be, m."""
    return rms(NODES if correction is None else sent_by(correction, NODES))


def rms(sent):
    places = NODES
    errors = tool_point(sent, CELL.errors, CELL.chain)[0] + bend(sent) - places
    turns = [np.cross(axis, places) for axis in np.eye(3)]
    shifts = [np.tile(axis, (len(places), 1)) for axis in np.eye(3)]
    rigid = np.stack([part.ravel() for part in (*turns, *shifts)], axis=1)
    weights, *_ = np.linalg.lstsq(rigid, errors.ravel(), rcond=None)
    left = errors.ravel() - rigid @ weights
    return float(np.sqrt(np.mean(np.sum(left.reshape(-1, 3) ** 2, axis=1))))


def stepdiag(*arguments):
    return cli.main([str(one) for one in arguments])


def diagnosed(bag, *more):
    folder = bag.parent / f"{bag.stem}_diagnosis"
    assert stepdiag("diagnose", bag, "--pictures", "none", "--output", folder, *more) == 0
    return json.loads((folder / "diagnosis.json").read_text())


def compensated(bag, control, folder, *more):
    given = ("--for", control, "--output", folder, "--pictures", "none")
    return stepdiag("compensate", bag, *given, *more)


@pytest.fixture(scope="module")
def learned(tmp_path_factory):
    """Measure the machine, and learn the bend; return the bag and the model."""
    folder = tmp_path_factory.mktemp("bend")
    bag, model = measured(folder, "first"), folder / "bent.yaml"
    document = diagnosed(bag, "--extend", model)
    assert document["verdict"] == "DESCRIBED"
    assert {*document["description"]["dependences"][0]["drivers"]} == {
        "the place of X",
        "the place of Z",
    }
    return bag, model


@pytest.fixture(scope="module")
def correction(learned):
    bag, model = learned
    assert compensated(bag, "generic", bag.parent / "map", "--model", model) == 0
    return correction_from_file(bag.parent / "map" / MAP, 0.2e-3)


def test_a_second_run_has_a_smaller_volumetric_error_and_no_gap(learned, correction):
    bag, _ = learned
    bare, left = volume(), volume(correction)
    assert compensated(bag, "generic", bag.parent / "curves", "--despite-verdict") == 0
    by_curves = volume(correction_from_file(bag.parent / "curves" / MAP, 0.2e-3))
    print(f"volume rms, µm: {1e6 * bare:.3f}, {1e6 * by_curves:.3f}, {1e6 * left:.4f}")
    assert bare > 1e-6
    assert bare / left > 30.0
    assert by_curves / left > 10.0
    second = diagnosed(measured(bag.parent, "second", correction, seed=2))
    assert second["verdict"] == CONSISTENT


def test_the_map_holds_the_bend_and_its_uncertainty(learned, correction):
    bag, model = learned
    (effect,) = yaml.safe_load(model.read_text())["effects"]
    read = map_from_text((bag.parent / "map" / MAP).read_text(), "map").error_map
    assert read.learned == correction.error_map.learned and len(read.learned) == 1
    assert read.learned[0].amplitude == effect["sizes"]["amplitude"]
    assert effect["domain"].keys() == {"X_m", "Z_m"}
    assert effect["domain"]["X_m"] == pytest.approx([LOW[0], HIGH[0]])
    spread = effect["standard_uncertainty"]["amplitude"]
    assert np.sqrt(read.learned_covariance[0, 0]) == pytest.approx(spread)
    far, near = np.atleast_2d(HIGH), np.atleast_2d([LOW[0], HIGH[1], HIGH[2]])
    bare = replace(read, learned=(), learned_covariance=np.empty((0, 0)))
    added = read.errors(far) - bare.errors(far)
    assert added == pytest.approx(np.array([[0.0, SIZE, 0.0]]), abs=0.2e-6)
    assert read.errors(near) == pytest.approx(bare.errors(near), abs=1e-18)
    wider = read.uncertainty_limit_at(far) - bare.uncertainty_limit_at(far)
    assert wider == pytest.approx(np.array([[0.0, spread, 0.0]]))


@pytest.mark.usefixtures("correction")
def test_the_documents_fit_their_schemas(learned, validators):
    bag, _ = learned
    made = (bag.parent / "first_diagnosis" / "diagnosis.json", bag.parent / "map" / MAP)
    for path in made:
        document = json.loads(path.read_text())
        assert not [error.message for error in validators[document["schema"]].iter_errors(document)]
    extended = json.loads(made[0].read_text())["extended_model"]["effects"]
    assert extended[0]["domain"].keys() == {"X_m", "Z_m"}


@pytest.mark.parametrize(("name", "gains"), [("siemens", True), ("linuxcnc", False)])
def test_tables_hold_the_part_that_depends_on_one_axis_and_say_so(learned, tmp_path, name, gains):
    bag, model = learned
    left = {}
    for kind, more in (("with", ("--model", model)), ("without", ("--despite-verdict",))):
        folder = tmp_path / kind
        assert compensated(bag, name, folder, *more) == 0
        files = {path.name: path.read_text() for path in folder.iterdir()}
        left[kind] = rms(control(name).read(files).sent(NODES, True))
    document = json.loads((tmp_path / "with" / "compensation.json").read_text())
    (effect,) = yaml.safe_load(model.read_text())["effects"]
    assert any(effect["setting"]["shape"] in said for said in document["uncorrected"])
    print(f"{name}: {1e6 * left['without']:.3f} µm, with the model {1e6 * left['with']:.3f} µm")
    # What the curves take up of the bend where it is not in the model is fitted to lines alone.
    assert left["with"] < left["without"] if gains else left["with"] < 1.05 * left["without"]


def test_a_program_is_divided_at_the_kinks_of_a_shape(correction):
    error_map = correction.error_map
    middle = 0.5 * (LOW + HIGH)
    bound = LearnedDisplacement("Y", "x>0.25 * z^2", 4e-6, {0: (LOW[0], HIGH[0]), 2: (0.0, 1.0)})
    bent = replace(error_map, learned=(bound,), learned_covariance=np.zeros((1, 1)))
    assert bent.planes(0) == pytest.approx(sorted([*error_map.nodes[0], 0.04]))
    assert bent.planes(2) == pytest.approx(error_map.nodes[2])
    ends = (np.array([end, *middle[1:]]) for end in (LOW[0], HIGH[0]))
    kinks = Division(bent, 1e-6).kinks(Motion(LINE, *ends))
    assert np.min(np.abs(kinks - 0.25)) < 1e-9


def test_beyond_its_domain_nothing_is_compensated(learned, tmp_path, capsys):
    _, model = learned
    longer = measured(tmp_path, "longer", plan_text=PLAN.replace("blocks: 6", "blocks: 7"))
    assert compensated(longer, "generic", tmp_path / "map", "--model", model) == 1
    said = capsys.readouterr().err
    assert "X 10 to 130 mm" in said and "X 10 to 150 mm" in said
    assert not (tmp_path / "map").exists()


def learned_file(tmp_path, **entry):
    text = {"effects": [{"effect": "learned shape", "sizes": {"amplitude": 1e-6}, **entry}]}
    path = tmp_path / "model.yaml"
    path.write_text(yaml.safe_dump(text))
    return path


def test_an_effect_that_goes_on_in_time_is_refused_by_its_driver(tmp_path, capsys):
    setting = {"acts_on": "Y", "shape": "x^1 * t^1"}
    model = learned_file(tmp_path, setting=setting)
    wander = load_model(model)[0].effects[0].active
    grown = replace(wander, sizes={"amplitude": 20e-6})
    bag = measured(tmp_path, "wander", added=grown.readings)
    assert compensated(bag, "generic", tmp_path / "map", "--model", model) == 1
    said = capsys.readouterr().err
    assert "depends on the place of X and time" in said
    assert not (tmp_path / "map").exists()


def test_a_model_without_a_domain_says_that_it_is_unknown(tmp_path):
    model = load_model(learned_file(tmp_path, setting={"acts_on": "Y", "shape": "x^1 * z^2"}))[0]
    given = Learned(model, "model")
    (said,) = given.warnings()
    assert "no domain" in said
    (one,) = displacements(given.effects, LOW, HIGH)
    places = np.array([HIGH, 0.5 * (LOW + HIGH), LOW])
    assert one.product(places) == pytest.approx([1.0, 0.125, 0.0])


def test_a_document_that_holds_no_lines_cannot_have_effects_taken_off(learned, tmp_path):
    _, model = learned
    (tmp_path / "results.json").write_text("{}")
    assert compensated(tmp_path / "results.json", "generic", tmp_path / "m", "--model", model) == 1


@pytest.mark.parametrize(
    ("acts_on", "shape", "box"),
    [("reading", "x^1", {0: (0.0, 1.0)}), ("Y", "t^1", {}), ("Y", "x^1 * z^1", {0: (0.0, 1.0)})],
)
def test_a_displacement_that_is_none_is_refused(acts_on, shape, box):
    with refused(Refusal):
        LearnedDisplacement(acts_on, shape, 1e-6, box)


def test_the_part_for_curves_is_the_nearest_sum_of_functions_of_one_place():
    box = {0: (0.0, 0.1), 2: (-0.2, 0.2)}
    one = LearnedDisplacement("Y", "x>0.5 * z^2", 2e-6, box)
    x, z = np.linspace(*box[0], 201), np.linspace(*box[2], 201)
    places = places_of([x, np.zeros(1), z])
    values = one.amplitude * one.product(places).reshape(len(x), len(z))
    left = values - one.along(0, x)[:, None] - one.along(2, z)[None, :]
    # Nothing of either place alone is left: every row and every column has the same mean.
    assert np.mean(left, axis=1) == pytest.approx(np.mean(left), abs=0.01e-6)
    assert np.mean(left, axis=0) == pytest.approx(np.mean(left), abs=0.01e-6)
    assert np.ptp(np.mean(values, axis=1)) > 0.5e-6
    assert one.along(1, x) == pytest.approx(0.0)
