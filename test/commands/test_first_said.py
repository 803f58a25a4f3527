"""What is said first of a run, and what may be made of it: for each verdict, and for half a run.

Judged by the lead that a document carries, by exit codes, and by what is on the disk.
"""

import json
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from report.pages.written_runs import with_backlash_of_x, write_lines
from standard_runs import cell

from stepdiag_ros import cli
from stepdiag_ros.bags.table import import_table
from stepdiag_ros.configuration import plan_from_text
from stepdiag_ros.evaluation import recorded_run
from stepdiag_ros.metrology.discrepancy.summary import Verdict
from stepdiag_ros.metrology.effects import angular_error, catalogue
from stepdiag_ros.metrology.effects.effect import ActiveEffect
from stepdiag_ros.metrology.geometry import SQUARENESS, TRANSLATIONS
from stepdiag_ros.metrology.simulation import simulate

pytestmark = pytest.mark.usefixtures("kept_results")

HEAD = """\
name: a run
step_m: [0.03, 0.02, 0.025]
blocks: 5
overrun_m: 0.002
feed_m_per_s: 0.05
"""
TWICE = "repeats: 2\ndirections: [forward, backward]\n"
DIAGONALS = "  - {kind: step_diagonal, names: [ppp, npp, pnp, ppn]}\n"
AXES = "  - {kind: linear, names: [x, y, z]}\n"
WHOLE = f"{HEAD}{TWICE}lines:\n{AXES}{DIAGONALS}"
MACHINE = "name: mill\nchain: YXZ\n"
POSITIONING = ["E_XX", "E_YY", "E_ZZ"]
CONTROLS = ("linuxcnc", "siemens", "generic")


class Run(NamedTuple):
    """What a run is made of.

    Attributes:
        plan: its text.
        change: lines of the simulation → lines of the run.
        effects: that act in the simulated cell.
    """

    plan: str = WHOLE
    change: object = tuple
    effects: tuple = ()


def worn(lines):
    """Return lines over a guide that is worn where X and Y meet: no effect does that."""
    made = []
    for line in lines:
        x, y, z = (line.target / (0.15, 0.10, 0.125)).T
        bump = 5e-6 * np.exp(-((x - 0.6) ** 2 + (y - 0.4) ** 2) / 0.04) * np.sign(z - 0.45)
        made.append(replace(line, displacement=line.displacement + bump - bump[0]))
    return made


def wandering(lines):
    """Return lines of a laser whose zero wanders at random, stop after stop."""
    rng = np.random.default_rng(3)
    return [
        replace(
            line,
            displacement=line.displacement
            + np.cumsum(np.append(0.0, 0.7e-6 * rng.standard_normal(len(line.time) - 1))),
        )
        for line in lines
    ]


def of_unknown_noise(lines):
    return [
        replace(line, standard_uncertainty=np.full(len(line.displacement), np.nan))
        for line in lines
    ]


def acting(name, setting, **sizes):
    return (ActiveEffect(catalogue()[name], setting, sizes),)


TURNED = acting(angular_error.EFFECT.name, {"error": "E_BX"}, linear=80e-6, quadratic=0.0)
RUNS = {
    "CONSISTENT": Run(),
    "NAMED, geometric": Run(change="backlash"),
    "NAMED, not geometric": Run(effects=acting("settling", {"axis": "Y"}, short_by=1e-6)),
    "AMBIGUOUS": Run(f"{HEAD}{TWICE}lines:\n{AXES}{DIAGONALS}".replace("5", "4", 1), tuple, TURNED),
    "DESCRIBED": Run(change=worn),
    "UNEXPLAINED": Run(change=wandering),
    "NOT TESTABLE": Run(f"{HEAD}lines:\n{AXES}{DIAGONALS}", change=of_unknown_noise),
    "cut short": Run(change=lambda lines: lines[:14]),
    "one pass short": Run(change=lambda lines: lines[:27]),
    "four diagonals alone": Run(f"{HEAD}{TWICE}lines:\n{DIAGONALS}"),
}


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    """Return the bag of a run by its name; each is made once."""
    made = {}

    def bag(name):
        if name not in made:
            run = RUNS[name]
            plan = plan_from_text(run.plan, "test plan")
            measured = simulate(plan, replace(cell(), effects=run.effects), seed=1)
            if run.change == "backlash":
                lines = with_backlash_of_x(measured, 2e-6)
            else:
                lines = run.change(measured.lines)
            made[name] = tmp_path_factory.mktemp("run") / "run.mcap"
            write_lines(made[name], run.plan, lines, MACHINE)
        return made[name]

    return bag


@pytest.fixture(scope="module")
def leads(bags, tmp_path_factory):
    """Return the lead of a run's results.json, and its report.txt, by the name of the run."""
    made = {}

    def lead(name):
        if name not in made:
            folder = tmp_path_factory.mktemp("results")
            given = ["solve", str(bags(name)), "--pictures", "none", "--output", str(folder)]
            assert cli.main(given) == 0
            document = json.loads((folder / "results.json").read_text(encoding="utf-8"))
            text = (folder / "report.txt").read_text(encoding="utf-8")
            made[name] = document["lead"], text
        return made[name]

    return lead


def commands_of(lead):
    """Return the subcommands that are to be run next."""
    return [one["command"].split()[1] for one in lead["next"] if one["command"]]


def test_the_runs_are_what_they_are_called(leads):
    for name in RUNS:
        verdict = leads(name)[0]["verdict"]["name"]
        if name[0].isupper():
            assert verdict == name.split(",")[0], name
    assert leads("NAMED, geometric")[0]["verdict"]["effects"] == ["backlash of X"]
    assert leads("NAMED, not geometric")[0]["verdict"]["effects"] == ["settling of Y"]
    assert leads("AMBIGUOUS")[0]["verdict"]["rivals"]


@pytest.mark.parametrize("name", RUNS)
def test_the_verdict_stands_before_any_size_and_in_the_same_words_everywhere(leads, name):
    lead, text = leads(name)
    sentences = lead["sentences"]
    place = int(lead["passes"]["complete"] < lead["passes"]["planned"])
    assert sentences[place].startswith(f"{lead['verdict']['name']}: {lead['verdict']['sentence']}")
    assert not any("µm" in one for one in sentences[:place])
    shown = text[text.index("In short:") :].splitlines()
    assert shown[1 : 1 + len(sentences)] == sentences


@pytest.mark.parametrize("name", RUNS)
def test_tables_are_proposed_only_where_they_may_be_made(leads, name):
    proposed = "compensate" in commands_of(leads(name)[0])
    assert proposed == (name in ("CONSISTENT", "NAMED, geometric"))


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("NAMED, not geometric", "--extend"),
        ("AMBIGUOUS", "--propose"),
        ("DESCRIBED", "--extend"),
        ("UNEXPLAINED", "diagnose"),
        ("NOT TESTABLE", "plan"),
    ],
)
def test_what_is_to_be_done_first_follows_from_the_verdict(leads, name, words):
    steps = [one["command"] or "" for one in leads(name)[0]["next"]]
    places = [number for number, step in enumerate(steps) if words in step]
    assert places and places[0] < [step.split()[1:2] for step in steps].index(["report"])


def test_a_run_cut_short_says_so_before_anything_else(leads):
    lead, text = leads("cut short")
    assert lead["passes"]["planned"] == 28 and lead["passes"]["complete"] == 14
    assert lead["passes"]["unit"] == "passes"
    assert lead["passes"]["missing"] == ["ppp XYZ", "npp XYZ", "pnp XYZ", "ppn XYZ"]
    assert "14 of 28" in lead["sentences"][0]
    assert "14 of 28" in text[text.index("In short:") :].splitlines()[1]
    first = lead["next"][0]
    assert first["command"] is None and all(
        one in first["why"] for one in lead["passes"]["missing"]
    )


def test_next_to_what_is_unknown_nothing_is_the_largest(leads):
    lead, _ = leads("four diagonals alone")
    assert lead["unknown"] == POSITIONING and "linear lines" in lead["remedy"]
    assert lead["largest_in_volume"] is None and lead["expanded_uncertainty"] is None
    known = {one["name"] for one in lead["single_errors"]}
    assert known and not known & set(POSITIONING)
    assert known <= {*TRANSLATIONS, *SQUARENESS}
    sentences = lead["sentences"]
    unknown = next(n for n, one in enumerate(sentences) if all(k in one for k in POSITIONING))
    largest = next(n for n, one in enumerate(sentences) if "peak to peak" in one)
    assert unknown < largest and "known" in sentences[largest]
    assert "linear lines" in lead["next"][0]["why"], "nothing acts: what is missing comes first"


def test_where_all_is_known_the_largest_is_that_of_the_machine(leads):
    lead, _ = leads("CONSISTENT")
    assert lead["unknown"] == [] and lead["remedy"] is None and lead["misfit"] == "none"
    values = [one["value"] for one in lead["single_errors"]]
    assert len(values) == 12 and values == sorted(values, reverse=True)
    assert lead["largest_in_volume"] > 0.0 and lead["expanded_uncertainty"] > 0.0


def test_the_page_to_hand_over_begins_with_the_same_sentences(bags, leads, tmp_path):
    for name in ("cut short", "NAMED, geometric", "four diagonals alone"):
        folder = tmp_path / name.replace(" ", "_")
        assert cli.main(["report", str(bags(name)), "--json", "--output", str(folder)]) == 0
        summary = json.loads((folder / "report.json").read_text(encoding="utf-8"))["summary"]
        lead = leads(name)[0]
        decide = [one for one in lead["sentences"] if "µm over" not in one and "±" not in one]
        decide = [one for one in decide if "without pitch, yaw and roll" not in one]
        assert decide and summary["sentences"][: len(decide)] == decide


def compensate(bag, folder, control, *further):
    given = ["compensate", str(bag), "--for", control, "--output", str(folder)]
    return cli.main([*given, "--pictures", "none", *further])


REFUSED = [
    ("NAMED, not geometric", CONTROLS),
    ("AMBIGUOUS", CONTROLS),
    ("DESCRIBED", ("generic",)),
    ("UNEXPLAINED", CONTROLS),
    # The map corrects a target, which does not know from which side it is approached.
    ("NAMED, geometric", ("generic", "siemens", "heidenhain", "fanuc")),
]


@pytest.mark.parametrize(
    ("name", "control"), [(name, one) for name, controls in REFUSED for one in controls]
)
def test_tables_are_refused_where_something_acts_that_they_do_not_hold(
    bags, tmp_path, capsys, name, control
):
    assert compensate(bags(name), tmp_path / "tables", control) == 1
    said = capsys.readouterr()
    assert said.out == "" and list(tmp_path.iterdir()) == []
    (sentence,) = said.err.strip().splitlines()
    assert name.split(",")[0] in sentence and "--despite-verdict" in sentence


@pytest.mark.parametrize("name", ["NAMED, not geometric", "AMBIGUOUS", "UNEXPLAINED"])
@pytest.mark.parametrize("control", CONTROLS)
def test_who_overrules_a_verdict_has_it_in_all_that_is_made(bags, tmp_path, capsys, name, control):
    folder = tmp_path / "tables"
    assert compensate(bags(name), folder, control, "--despite-verdict", "--json") == 0
    said = capsys.readouterr()
    verdict = name.split(",")[0]
    document = json.loads(said.out)
    assert document["origin"]["despite_verdict"].startswith(verdict)
    assert "warning" in said.err and verdict in said.err
    text = (folder / "compensation.txt").read_text(encoding="utf-8")
    assert verdict in text.splitlines()[1]
    files = {one["name"]: (folder / one["name"]).read_text() for one in document["files"]}
    if control == "siemens":
        assert all(f"despite the verdict: {verdict}" in one for one in files.values())
    if control == "generic":
        map_document = json.loads(files["volumetric_map.json"])
        assert map_document["origin"]["despite_verdict"].startswith(verdict)


@pytest.mark.parametrize(
    ("name", "control", "further"),
    [
        ("CONSISTENT", "linuxcnc", ()),
        ("CONSISTENT", "generic", ()),
        ("NAMED, geometric", "linuxcnc", ()),
        ("NAMED, geometric", "siemens", ("--set", "reversal=tables", "--set", "tables=12")),
    ],
)
def test_what_the_tables_hold_is_no_reason_to_refuse(
    bags, tmp_path, capsys, name, control, further
):
    folder = tmp_path / "tables"
    assert compensate(bags(name), folder, control, "--json", *further) == 0
    said = capsys.readouterr()
    assert "warning" not in said.err
    origin = json.loads(said.out)["origin"]
    assert origin["despite_verdict"] is None and origin["verdict"].startswith(name.split(",")[0])


@pytest.mark.parametrize(
    ("name", "words"), [("NOT TESTABLE", "NOT TESTABLE"), ("one pass short", "27 of 28")]
)
def test_what_is_untested_or_cut_short_is_warned_of_first_and_goes_on(
    bags, tmp_path, capsys, name, words
):
    assert compensate(bags(name), tmp_path / "tables", "generic", "--json") == 0
    said = capsys.readouterr()
    warnings = [line for line in said.err.splitlines() if "warning" in line]
    assert any(words in line for line in warnings)
    assert said.err.index(words) < said.err.index("tables in")
    document = json.loads(said.out)
    assert document["origin"]["despite_verdict"] is None
    assert any(words in one for one in document["remarks"])


@pytest.mark.parametrize("contained", [True, False])
def test_rotations_that_uncertainties_contain_are_warned_of(
    bags, tmp_path, capsys, monkeypatch, contained
):
    turns = Verdict("NAMED", "The model lacks it.", ("angular error E_CZ",), contained=contained)
    monkeypatch.setattr(recorded_run, "verdict_on", lambda _: turns)
    bag, results = bags("CONSISTENT"), tmp_path / "r"
    given = ["solve", str(bag), "--pictures", "none", "--output", str(results)]
    assert cli.main(given) == 0
    for source in (bag, results / "results.json"):
        capsys.readouterr()
        made = compensate(source, tmp_path / f"from {source.name}", "generic")
        said = capsys.readouterr().err
        assert made == (0 if contained else 1) and "angular error E_CZ" in said
        assert ("warning" in said) == contained == ("--despite-verdict" not in said)


def test_results_carry_the_verdict_and_earlier_ones_without_it_are_warned_of(
    bags, tmp_path, capsys
):
    results = tmp_path / "r"
    given = ["solve", str(bags("UNEXPLAINED")), "--pictures", "none", "--output", str(results)]
    assert cli.main(given) == 0
    path = results / "results.json"
    assert compensate(path, tmp_path / "tables", "generic") == 1
    assert not (tmp_path / "tables").exists()
    document = json.loads(path.read_text(encoding="utf-8"))
    del document["lead"]
    path.write_text(json.dumps(document), encoding="utf-8")
    capsys.readouterr()
    assert compensate(path, tmp_path / "tables", "generic") == 0
    assert "NOT DIAGNOSED" in capsys.readouterr().err


PROGRAM = "G21 G90 G54\nG0 X0 Y0 Z0\nG1 X60 Y40 Z20 F500\nM30\n"


def test_a_program_is_refused_and_overruled_in_the_same_way(bags, tmp_path, capsys):
    program = tmp_path / "part.nc"
    program.write_text(PROGRAM)
    written = tmp_path / "part_corrected.nc"

    def rewrite(source, *further):
        given = ["compensate-nc", str(program), str(source), "--offset", "G54=30,20,20"]
        return cli.main([*given, *further])

    for name in ("NAMED, not geometric", "UNEXPLAINED", "NAMED, geometric"):
        assert rewrite(bags(name)) == 1
        assert name.split(",")[0] in capsys.readouterr().err and not written.exists()
    assert rewrite(bags("UNEXPLAINED"), "--despite-verdict", "--json") == 0
    document = json.loads(capsys.readouterr().out)
    assert document["origin"]["despite_verdict"] == "UNEXPLAINED"
    assert "despite the verdict: UNEXPLAINED" in written.read_text()
    written.unlink()
    # A map does not wash the verdict off.
    folder = tmp_path / "map"
    assert compensate(bags("UNEXPLAINED"), folder, "generic", "--despite-verdict") == 0
    assert rewrite(folder / "volumetric_map.json") == 1 and not written.exists()
    assert rewrite(folder / "volumetric_map.json", "--despite-verdict") == 0 and written.exists()
    written.unlink()
    assert compensate(bags("CONSISTENT"), tmp_path / "good", "generic") == 0
    capsys.readouterr()
    assert rewrite(tmp_path / "good" / "volumetric_map.json") == 0
    assert "warning" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("case", "verdict", "acts"),
    [
        ("effect_b", "NAMED", ["thermal growth of Z"]),
        ("effect_c", "NAMED", ["angular error E_CZ"]),
        ("null_rich", "CONSISTENT", []),
    ],
)
def test_the_cases_that_are_known(tmp_path, pytestconfig, case, verdict, acts):
    bag = tmp_path / "case.mcap"
    import_table(pytestconfig.rootpath / "test/data/cases" / case / "run.csv", None, bag)
    folder = tmp_path / "results"
    given = ["solve", str(bag), "--pictures", "none", "--output", str(folder)]
    assert cli.main(given) == 0
    lead = json.loads((folder / "results.json").read_text(encoding="utf-8"))["lead"]
    assert (lead["verdict"]["name"], lead["verdict"]["effects"]) == (verdict, acts)
    assert compensate(bag, tmp_path / "tables", "generic") == int(bool(acts))
    assert (tmp_path / "tables").exists() == (not acts)
