"""Reports of runs that are not fine: what is known, where the gap is, what to measure next."""

import json
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest
from report.pages.page_reading import ReadPage
from report.pages.written_runs import write_lines
from standard_runs import cell

from stepdiag_ros.cli import main
from stepdiag_ros.configuration import plan_from_text
from stepdiag_ros.metrology.effects import angular_error, backlash, cosine_error
from stepdiag_ros.metrology.effects.effect import ActiveEffect
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.report.pages import material, pictures
from stepdiag_ros.report.pages.pictures import Drawn, Studio

PLAN = """\
name: troubled run
step_m: [0.03, 0.02, 0.025]
blocks: 4
repeats: 2
directions: [forward, backward]
feed_m_per_s: 0.05
lines:
  - {kind: linear, names: [x, y, z]}
  - {kind: step_diagonal, names: [ppp, npp, pnp, ppn]}
"""
MACHINE = "name: mill\nchain: YXZ\n"


class _Undrawn(Studio):
    """Stands in for a studio where only the words of a report are asked for."""

    def fetch_all(self):
        drawn = {}
        for (chapter, name), one in self._asked.items():
            drawn.setdefault(chapter, {})[name] = Drawn(one.caption, "any")
        return drawn


@contextmanager
def undrawn(beside=True):
    del beside
    yield _Undrawn()


def _measured(effects=()):
    truth = replace(cell(), effects=effects)
    return simulate(plan_from_text(PLAN, "test plan"), truth, seed=1).lines


def _reported(path, lines, effects):
    write_lines(path, PLAN, lines, MACHINE)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pictures, "studio", undrawn)
        # What the whole catalogue finds is the engine's own test.
        patch.setattr(material, "catalogue", lambda: {one.name: one for one in effects})
        assert main(["report", str(path), "--html", "--json"]) == 0
    folder = path.with_name(f"{path.stem}_report")
    return (
        ReadPage((folder / "report.html").read_text(encoding="utf-8")),
        json.loads((folder / "report.json").read_text(encoding="utf-8")),
    )


@pytest.fixture(scope="module")
def unexplained(tmp_path_factory):
    """The zero of the laser wanders at random, stop after stop."""
    rng = np.random.default_rng(3)
    lines = []
    for line in _measured():
        steps = 0.7e-6 * rng.standard_normal(len(line.time) - 1)
        wander = np.cumsum(np.append(0.0, steps))
        lines.append(replace(line, displacement=line.displacement + wander))
    path = tmp_path_factory.mktemp("unexplained") / "wandering.mcap"
    return _reported(path, lines, [backlash.EFFECT])


@pytest.fixture(scope="module")
def described(tmp_path_factory):
    """Where X and Y meet a guide is worn: no effect of the catalogue does that."""
    lines = []
    for line in _measured():
        x, y, z = (line.target / (0.12, 0.08, 0.1)).T
        bump = 5e-6 * np.exp(-((x - 0.6) ** 2 + (y - 0.4) ** 2) / 0.04) * np.sign(z - 0.45)
        lines.append(replace(line, displacement=line.displacement + bump - bump[0]))
    path = tmp_path_factory.mktemp("described") / "worn.mcap"
    return _reported(path, lines, [backlash.EFFECT])


@pytest.fixture(scope="module")
def ambiguous(tmp_path_factory):
    """A turn of one axis, which looks like a beam out of line."""
    turn = ActiveEffect(
        angular_error.EFFECT, {"error": "E_BX"}, {"linear": 80e-6, "quadratic": 0.0}
    )
    path = tmp_path_factory.mktemp("ambiguous") / "turned.mcap"
    return _reported(path, _measured((turn,)), [angular_error.EFFECT, cosine_error.EFFECT])


def test_an_unexplained_run_says_what_is_known_where_the_gap_is_and_what_to_measure(unexplained):
    told, document = unexplained
    found = document["sections"]["discrepancy"]
    assert found["verdict"] == "UNEXPLAINED"
    assert told.headings[0] == (
        "Something acts in this machine that the error curves do not contain"
    )
    first, second = document["summary"]["what_to_do"][:2]
    assert first.startswith("find the cause of the gap") and found["where"][0] in first
    assert second.startswith("measure ") or second.startswith("it repeats")
    assert "Known: the gap is" in told.text and "times the noise of a stop" in told.text
    story = told.headings[told.headings.index("UNEXPLAINED") :]
    assert story.index("Where the gap is") < story.index("What to measure next")
    assert "What closes it" not in told.headings


def test_a_described_run_says_on_what_the_gap_depends_and_by_what_formula(described):
    told, document = described
    found = document["sections"]["discrepancy"]
    assert found["verdict"] == "DESCRIBED"
    for dependence in found["description"]["dependences"]:
        for words in dependence["drivers"]:
            assert words in told.text
    for finding in found["findings"]:
        assert finding["label"] in told.text
    story = told.headings[told.headings.index("DESCRIBED") :]
    assert story.index("Where the gap is") < story.index("On what it depends")
    assert document["summary"]["what_to_do"][0].startswith("find the cause of the gap")


@pytest.mark.parametrize("run", ["unexplained", "described"])
def test_tables_of_a_run_with_an_unknown_cause_are_not_to_be_installed(run, request):
    told, _ = request.getfixturevalue(run)
    assert "Do not install these tables: the run shows something" in told.text
    assert "could bring the largest error" not in told.text


def test_an_ambiguous_run_says_between_what_it_cannot_choose_and_what_would_tell(ambiguous):
    told, document = ambiguous
    found = document["sections"]["discrepancy"]
    assert found["verdict"] == "AMBIGUOUS"
    kinds, measure, file = document["summary"]["what_to_do"][:3]
    assert "angular error" in kinds and "cosine error" in kinds
    assert measure == f"measure next: {found['proposal']['sentence']}"
    assert found["proposal"]["passes"], "an extra plan exists for a turn beside a cosine error"
    assert "--propose more.yaml" in file
    assert "Between what this run cannot choose" in told.headings
    assert "What would close it" in told.headings and "What closes it" not in told.headings
    assert found["proposal"]["sentence"] in told.text
    assert "Do not install these tables yet" in told.text


def test_a_run_with_rejected_stops_says_so_on_the_first_page(tmp_path):
    lines = list(_measured())
    gaps = lines[1].displacement.copy()
    gaps[2] = np.nan
    lines[1] = replace(lines[1], displacement=gaps)
    told, document = _reported(tmp_path / "gaps.mcap", lines, [backlash.EFFECT])
    said = document["summary"]["sentences"][0]
    assert said == "The measurement is not complete: 27 of 28 planned passes have every stop."
    assert said in told.text
    assert "Do not install" not in told.text


def test_where_nothing_could_contradict_the_model_no_gap_is_shown(tmp_path):
    lines = [line for line in _measured() if line.line.name == "x" and line.line.repeat == 0][:1]
    told, document = _reported(tmp_path / "x.mcap", lines, [backlash.EFFECT])
    assert document["sections"]["discrepancy"]["verdict"] == "NOT TESTABLE"
    (decision,) = document["summary"]["decisions"]
    assert decision["tested"] is False and decision["position"] is decision["value"] is None
    assert "Where the gap is" not in told.headings
    assert not [name for name in told.tables if name.startswith("The gap")]
    assert "Squareness is unknown: the measured lines do not determine it." in told.text
    assert "These lines do not determine the largest error in the volume." in told.text
