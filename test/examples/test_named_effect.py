"""A described effect that somebody names: its package, installed, is named by the diagnosis."""

import json

import yaml
from other_package import install, stepdiag
from test_outside_effect import write_run

try:
    import tomllib
except ModuleNotFoundError:  # Python 3.10
    import tomli as tomllib

BOX = {"X_m": [0.0, 0.06], "Z_m": [0.0, 0.06]}
BEND = {
    "effect": "learned shape",
    "setting": {"acts_on": "Y", "shape": "x>0.5 * z>0.5"},
    "domain": BOX,
    "sizes": {"amplitude": 3e-6},
}
CELL = {
    "seed": 5,
    "chain": "YXZ",
    "reading_noise_m": 5e-8,
    "misalignment": {"beam_sigma_rad": 1e-4},
    "errors": {
        "travel_low_m": [0.0, 0.0, 0.0],
        "travel_high_m": [0.06, 0.06, 0.06],
        "positioning_m": 2e-6,
        "straightness_m": 1e-6,
    },
    "effects": [BEND],
}


def test_a_named_effect_takes_the_place_of_its_description(tmp_path):
    write_run(tmp_path, CELL)
    model = tmp_path / "model.yaml"
    model.write_text(yaml.safe_dump({"effects": [BEND]}))
    package, site = tmp_path / "package", tmp_path / "site"
    done = stepdiag("effect", "new", "quadrant-bend", "--model", model, "--output", package)
    assert done.returncode == 0, done.stderr
    site.mkdir()
    record = tomllib.loads((package / "pyproject.toml").read_text())
    (module,) = record["tool"]["setuptools"]["py-modules"]
    made = (package / f"{module}.py").read_text()
    texts = {module: made.replace('sentence = ""', 'sentence = "The column bends at a corner."')}
    project = record["project"]
    install(site, project["name"], texts, project["entry-points"], project["version"])
    found = {}
    for name, path in (("without", None), ("with", site)):
        given = ("--json", "--pictures", "none", "--output", tmp_path / name)
        done = stepdiag("diagnose", tmp_path / "run.csv", *given, site=path)
        assert done.returncode == 0, done.stderr
        found[name] = json.loads(done.stdout)
    assert found["without"]["verdict"] == "DESCRIBED"
    assert found["with"]["verdict"] == "NAMED"
    (finding,) = found["with"]["findings"]
    low, high = finding["sizes"][0]["band_95"]
    assert finding["effect"] == "quadrant bend"
    assert low < BEND["sizes"]["amplitude"] < high
