"""An effect of another package, as ``docs/effects.md`` has it: installed, hidden, named, modelled.

The files are taken from that page, and installed as a distribution of their own in a folder on
the path; every command runs in a process of its own, which finds the effect by its entry point.
"""

import csv
import json
import re
from pathlib import Path

import pytest
import yaml
from other_package import ROOT, install, python, stepdiag

try:
    import tomllib
except ModuleNotFoundError:  # Python 3.10
    import tomli as tomllib

PAGE = (ROOT / "docs" / "effects.md").read_text(encoding="utf-8")
SETTING = {"axis": "Z", "period_s": 300.0}
SIZES = {"sine": 0.6e-6, "cosine": 0.3e-6}
LABEL = "cooler cycle of Z, period 300 s"

SIMULATE = """
import sys, yaml
sys.path[:0] = {tests!r}
from test_outside_effect import write_run
write_run({folder!r}, yaml.safe_load(open({cell!r})))
"""


def _block(language, file=""):
    """Return the one block of a language on the page, or the one that a file's name introduces."""
    before = f"`{re.escape(file)}`:\n\n" if file else ""
    (text,) = re.findall(rf"{before}```{language}\n(.*?)```", PAGE, re.DOTALL)
    return text


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """Install what the page shows: a module, and the record of its distribution."""
    folder = tmp_path_factory.mktemp("site")
    project = tomllib.loads(_block("toml"))
    described = project["project"]
    modules = project["tool"]["setuptools"]["py-modules"]
    texts = dict.fromkeys(modules, _block("python", "cooler_cycle.py"))
    install(folder, described["name"], texts, described["entry-points"], described["version"])
    return folder


def write_run(folder, cell_file):
    """Simulate a cell at the stops of a small plan, and write the run table."""
    from stepdiag_ros.metrology.cell import SimulatedCell
    from stepdiag_ros.metrology.plan import Plan
    from stepdiag_ros.metrology.simulation import simulate

    groups = [
        {"kind": "linear", "names": ["x", "y", "z"]},
        {"kind": "step_diagonal", "names": ["ppp", "npp", "pnp", "ppn"], "orders": ["XYZ"]},
    ]
    plan = Plan.from_mapping(
        {
            "step_m": [0.01, 0.01, 0.01],
            "blocks": 6,
            "repeats": 2,
            "directions": ["forward", "backward"],
            "feed_m_per_s": 0.05,
            "sampling": {"dwell_s": 4.0},
            "lines": groups,
        },
        "plan",
    )
    run = simulate(plan, SimulatedCell.from_mapping(cell_file, "cell"), seed=3)
    folder = Path(folder)
    names = (
        "time_s,kind,line,order,repeat,direction,stop,x_m,y_m,z_m,reading_m,air_temperature_degC,"
        "air_pressure_Pa,relative_humidity,material_temperature_degC"
    )
    with (folder / "run.csv").open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(names.split(","))
        for line in run.lines:
            of = line.line
            for stop in range(len(line.time)):
                table.writerow(
                    [
                        line.time[stop],
                        *(of.kind, of.name, of.order, of.repeat, of.direction, stop),
                        *line.target[stop],
                        line.displacement[stop],
                        *line.environment[stop],
                    ]
                )
    case = {
        "chain": run.chain,
        "origin_m": [0.0, 0.0, 0.0],
        "step_m": [0.01, 0.01, 0.01],
        "blocks": 6,
        "reading_noise_m": 1e-7,
    }
    (folder / "case.yaml").write_text(yaml.safe_dump(case))


@pytest.fixture(scope="module")
def hidden(installed, tmp_path_factory):
    """Return a run table of a simulated machine whose cell file names the outside effect."""
    folder = tmp_path_factory.mktemp("hidden")
    cell = {
        "seed": 5,
        "chain": "YXZ",
        "reading_noise_m": 1e-7,
        "misalignment": {"beam_sigma_rad": 1e-4},
        "errors": {
            "travel_low_m": [0.0, 0.0, 0.0],
            "travel_high_m": [0.06, 0.06, 0.06],
            "positioning_m": 2e-6,
            "straightness_m": 1e-6,
        },
        **yaml.safe_load(_block("yaml", "cell.yaml")),
    }
    (folder / "cell.yaml").write_text(yaml.safe_dump(cell))
    script = SIMULATE.format(
        tests=[str(one) for one in Path(__file__).parents[:2]],
        folder=str(folder),
        cell=str(folder / "cell.yaml"),
    )
    done = python("-c", script, site=installed)
    assert done.returncode == 0, done.stderr
    return folder / "run.csv"


@pytest.fixture(scope="module")
def named(installed, hidden):
    """Diagnose the run with the package installed; return the document and the folder."""
    folder = hidden.parent / "out"
    done = stepdiag(
        *("diagnose", hidden, "--json", "--extend", hidden.parent / "mine.yaml"),
        *("--output", folder),
        site=installed,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout), folder


def test_it_is_named_with_its_setting_and_sizes(named):
    document, _ = named
    assert document["verdict"] == "NAMED"
    (finding,) = document["findings"]
    assert finding["effect"] == "cooler cycle"
    assert finding["setting"] == SETTING
    assert finding["label"] == LABEL
    assert finding["source"].startswith("manual of the cooling unit")
    for size in finding["sizes"]:
        low, high = size["band_95"]
        assert low < SIZES[size["name"]] < high
        assert 0.0 < high - low < 0.3e-6


def test_it_shows_in_the_report_like_any_other(named):
    _, folder = named
    for name in ("diagnosis.html", "diagnosis.txt"):
        text = (folder / name).read_text(encoding="utf-8")
        assert LABEL in text
        assert "The column bends to and fro" in " ".join(text.split())


def test_a_model_holds_it_and_the_run_agrees_with_the_model(hidden, named):
    document, _ = named
    model = yaml.safe_load((hidden.parent / "mine.yaml").read_text())
    (part,) = model["effects"]
    assert (part["effect"], part["setting"]) == ("cooler cycle", SETTING)
    assert [one["verdict"] for one in document["rounds"]] == ["CONSISTENT"]
    assert document["extended_model"]["effects"][0]["sizes"] == part["sizes"]


@pytest.mark.usefixtures("named")
def test_without_the_package_it_is_only_described_and_its_model_is_refused(hidden):
    done = stepdiag(
        *("diagnose", hidden, "--json", "--pictures", "none", "--output", hidden.parent / "bare")
    )
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    assert document["verdict"] == "DESCRIBED"
    assert document["description"]["dependences"][0]["drivers"] == ["time, periodically"]
    assert {one["effect"] for one in document["findings"]} == {"learned shape"}
    refused = stepdiag("diagnose", hidden, "--model", hidden.parent / "mine.yaml")
    assert refused.returncode == 1
    assert "cooler cycle" in refused.stderr
    assert len(refused.stderr.strip().splitlines()) == 1


def test_a_package_that_is_broken_is_named_in_one_sentence(installed, hidden, tmp_path):
    broken = tmp_path / "site"
    broken.mkdir()
    for path in installed.rglob("*"):
        if path.is_file() and path.suffix != ".pyc":
            copy = broken / path.relative_to(installed)
            copy.parent.mkdir(exist_ok=True)
            copy.write_text(path.read_text())
    (broken / "cooler_cycle.py").write_text("import a_module_that_is_not_there\n")
    done = stepdiag("diagnose", hidden, "--output", tmp_path / "none", site=broken)
    assert done.returncode == 1
    assert "of the package cooler-cycle" in done.stderr
    assert "a_module_that_is_not_there" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "none").exists()


@pytest.mark.parametrize(
    ("right", "wrong", "failing"),
    [
        ("", "", set()),
        ("np.sin(phase)", "-np.sin(phase)", {"test_the_formula_by_hand"}),
        (
            "stops.duration > 2.0 * period",
            "True",
            {"test_a_run_of_less_than_two_periods_cannot_show_it"},
        ),
        (
            "phase = 2.0 * np.pi * stops.time",
            "phase = 2.0 * np.pi * 300.0 * stops.share[:, 2]",
            {"test_the_formula_by_hand", "test_it_is_named_where_it_is_hidden"},
        ),
    ],
    ids=["as shown", "sign", "always tried", "an error curve"],
)
def test_the_tests_of_the_page_pass_and_can_fail(tmp_path, right, wrong, failing):
    module, tests = "cooler_cycle.py", "test_cooler_cycle.py"
    (tmp_path / module).write_text(_block("python", module).replace(right, wrong))
    (tmp_path / tests).write_text(_block("python", tests))
    done = python("-m", "pytest", "-q", "-p", "no:cacheprovider", tmp_path, site=tmp_path)
    assert set(re.findall(r"^FAILED .*::(\w+)", done.stdout, re.MULTILINE)) == failing, done.stdout
    assert f"{3 - len(failing)} passed" in done.stdout, done.stdout


def test_the_example_is_clean(tmp_path):
    source = tmp_path / "cooler_cycle.py"
    source.write_text(_block("python", "cooler_cycle.py"))
    settings = ROOT / "pyproject.toml"
    for check in (("ruff", "check"), ("ruff", "format", "--check")):
        done = python("-m", *check, "--config", settings, source)
        assert done.returncode == 0, done.stdout
