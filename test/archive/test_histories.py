"""What an archive shows of its machines over years, and ``stepdiag history`` as a user calls it."""

import importlib.util
import json
from datetime import datetime, timedelta, timezone
from pathlib import Path

import numpy as np
import pytest
from archive_runs import digest, made_up
from refused import refused

from stepdiag_ros.archive import catalogue
from stepdiag_ros.archive.catalogue import Catalogue
from stepdiag_ros.archive.histories import axes_of, histories, series_of
from stepdiag_ros.archive.place import Place
from stepdiag_ros.archive.rows import Rows
from stepdiag_ros.archive.stated import FILE
from stepdiag_ros.cli import main
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.trends.crossing import Outlook
from stepdiag_ros.plots.trends import years_of_machine
from stepdiag_ros.text.numbers import with_expanded
from stepdiag_ros.words.trends import now_words, remarks

BEGAN = datetime(2021, 1, 1, tzinfo=timezone.utc)
TALES = {"lathe": 6e-6, "mill": 0.0, "new": 1e-6}
"""Machine → wear of its C0Y a year."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return the folder of an archive with two machines of thirty runs, and one of four."""
    place = Place(str(tmp_path_factory.mktemp("plant")))
    rows, number = Rows(), 0
    random = np.random.default_rng(0)
    for machine, wear in TALES.items():
        for run in range(4 if machine == "new" else 30):
            number += 1
            days = 50.0 * run + float(random.uniform(0.0, 20.0))
            made = made_up(
                digest(number),
                "part",
                machine="mill (old)" if machine == "mill" and run < 10 else machine,
                start_time=BEGAN + timedelta(days=days),
                instrument="laser",
                instrument_serial_number="L1",
                material_temperature_degC=float(random.normal(21.0, 1.0)),
                material_temperature_range_K=0.2,
            )
            for figure in made.figures:
                value = wear * days / 365.0 if figure.name == "C0Y" else 0.0
                value += 2e-5 if machine == "mill" and run >= 20 else 0.0
                object.__setattr__(figure, "value", value + float(random.normal(0.0, 5e-7)))
            for table in ("runs", "figures", "curves"):
                getattr(rows, table).extend(getattr(made, table))
    catalogue.write_part(place, "part", rows)
    return place


@pytest.fixture
def place(folder):
    """Return the archive without what its owner states."""
    yield folder
    if folder.exists(FILE):
        folder.remove(FILE)


def state(place, text, tmp_path):
    """State something on the archive."""
    path = tmp_path / FILE
    path.write_text(text)
    if place.exists(FILE):
        place.remove(FILE)
    place.put(path, FILE)


def read(place, machine=""):
    """Return the histories by name of the machine."""
    with Catalogue(place) as opened:
        return {one.name: one for one in histories(opened, machine)}


def figure(history, name):
    """Return a figure of a machine."""
    return next(one for one in history.figures if one.name == name)


def test_wear_steps_and_renamed_machines(place, tmp_path):
    text = "machines:\n  mill (old): mill\ntolerances:\n  C0Y: 4.0e-5\n  mill: {C0Y: 1.0e-5}\n"
    state(place, text, tmp_path)
    found = read(place)
    assert {name: one.runs for name, one in found.items()} == {"lathe": 30, "mill": 30, "new": 4}
    worn = figure(found["lathe"], "C0Y")
    assert worn.trend.slope == pytest.approx(6e-6, abs=1.5 * worn.trend.slope_expanded)
    assert worn.trend.grows() and worn.trend.crossing.outlook is Outlook.INTERVAL
    hit = figure(found["mill"], "C0Y")
    assert [(one.kind, one.run) for one in hit.trend.changed()] == [("step", 20)]
    assert hit.trend.crossing.outlook is Outlook.OUTSIDE and hit.tolerance == 1e-5
    few = figure(found["new"], "C0Y")
    assert few.trend.unknown == "runs" and few.trend.crossing.outlook is Outlook.UNKNOWN
    assert figure(found["new"], "positioning E_XX").trend.crossing.outlook is Outlook.NOT_ASKED


def test_a_wrong_clock_is_set_right_and_a_run_in_two_bags_counts_once(place, tmp_path):
    twin = made_up(digest(900), "twin", machine="lathe", run_id=f"run {digest(3)[:8]}")
    for one in (*twin.runs, *twin.figures, *twin.curves):
        object.__setattr__(one, "start_time", read(place)["lathe"].figures[0].times[2])
    catalogue.write_part(place, "twin", twin)
    try:
        assert read(place)["lathe"].runs == 30
        state(place, f"times:\n  {digest(3)}: 2019-01-01T00:00:00+00:00\n", tmp_path)
        assert read(place)["lathe"].first.year == 2019
    finally:
        for table in ("runs", "figures", "curves"):
            place.remove(f"{catalogue.FOLDER}/1/{table}/twin.parquet")


def test_what_is_stated_of_scales_widens_what_depends_on_them(place, tmp_path):
    before = read(place, "lathe")["lathe"]
    state(place, "scales:\n  L1: 1.0e-5\n", tmp_path)
    after = read(place, "lathe")["lathe"]
    assert after.scale_known and not before.scale_known
    # The travel of X is 0.1 m: 1 µm.
    wide = [figure(one, "positioning E_XX").trend.level_expanded for one in (before, after)]
    assert wide[1] == pytest.approx(np.hypot(wide[0], 2e-6), rel=0.1)
    angles = [figure(one, "C0Y").trend.level_expanded for one in (before, after)]
    assert angles[0] == pytest.approx(angles[1])


def series_in_boxes(tmp_path, sides):
    """Return the history of a machine whose runs measured X from 0 to these ends, m."""
    place, rows = Place(str(tmp_path / "boxes")), Rows()
    for number, side in enumerate(sides):
        made = made_up(
            digest(number), "part", machine="m", start_time=BEGAN + timedelta(hours=number)
        )
        object.__setattr__(made.curves[0], "position_m", [0.0, side])
        for one in made.figures:
            object.__setattr__(one, "value", 1e-6 * side)
        for table in ("runs", "figures", "curves"):
            getattr(rows, table).extend(getattr(made, table))
    catalogue.write_part(place, "part", rows)
    return place, read(place, "m")["m"]


@pytest.mark.parametrize(("shared", "names"), [(float("nan"), 2), (1e-7, 1)])
def test_runs_with_other_air_sensors_share_an_error_only_where_the_scale_is_stated(shared, names):
    unknown = ("material_temperature_degC", "expanded_uncertainty", "scatter_standard_uncertainty")
    row = dict.fromkeys(("instrument", "layout", *unknown))
    row |= {"material_temperature_range_K": None, "instrument_serial_number": "L1"}
    row |= {"value": 1e-6, "standard_uncertainty": 1e-7}
    rows = [
        row | {"time": BEGAN + timedelta(days=days), "weather_station": station}
        for days, station in enumerate(("W1", "W2", "W1"))
    ]
    made = series_of(rows, shared).instruments
    assert len(set(made)) == names and made[0] == made[2]


def test_what_rotations_do_to_all_runs_of_a_layout_is_in_the_level_and_in_no_change(tmp_path):
    random, levels = np.random.default_rng(1), {}
    for scatter in (None, 2e-7):
        place, rows = Place(str(tmp_path / f"layouts {scatter}")), Rows()
        for number in range(20):
            made = made_up(
                digest(number), "part", start_time=BEGAN + timedelta(days=number), layout="a"
            )
            for one in made.figures:
                object.__setattr__(one, "value", 2e-6 * (number >= 12) + random.normal(0.0, 2e-7))
                object.__setattr__(one, "machine", "m")
                object.__setattr__(one, "standard_uncertainty", 5e-6)
                object.__setattr__(one, "scatter_standard_uncertainty", scatter)
            for table in ("runs", "figures", "curves"):
                getattr(rows, table).extend(getattr(made, table))
        catalogue.write_part(place, "part", rows)
        levels[scatter] = figure(read(place, "m")["m"], "C0Y")
    assert [one.run for one in levels[2e-7].trend.changes] == [12]
    assert levels[2e-7].trend.level_expanded > 1.9 * 5e-6
    assert levels[2e-7].expanded == pytest.approx(levels[None].expanded)
    # Where the two are not separated, as in a catalogue of an earlier version:
    assert not levels[None].trend.changes


def test_what_depends_on_the_box_is_followed_in_the_newest_box_only(tmp_path):
    history = series_in_boxes(tmp_path, (0.12, 0.03, 0.12, 0.1201))[1]
    positioning, angle = figure(history, "positioning E_XX"), figure(history, "C0Y")
    assert (positioning.other_boxes, len(positioning.values)) == (1, 3)
    assert 0.03e-6 not in [pytest.approx(one) for one in positioning.values]
    assert (angle.other_boxes, len(angle.values)) == (0, 4)
    assert history.runs == 4
    assert sum("box" in one for one in remarks(history)) == 1
    same = series_in_boxes(tmp_path / "same", (0.12, 0.12))[1]
    assert not any("box" in one for one in remarks(same))


@pytest.mark.parametrize(
    ("name", "axes"),
    [
        ("largest in volume", (0, 1, 2)),
        ("diagonal ppp", (0, 1, 2)),
        ("positioning E_YY", (1,)),
        ("straightness E_YX", (0,)),
        ("angular E_AZ", (2,)),
        ("C0Y", ()),
        ("backlash of X: lost_motion", ()),
    ],
)
def test_the_axes_that_a_figure_depends_on(name, axes):
    assert axes_of(name) == axes


def test_of_few_runs_the_last_value_is_shown_and_the_picture_has_a_scale_of_its_runs(
    tmp_path, capsys
):
    place, history = series_in_boxes(tmp_path, (0.12, 0.12, 0.12))
    one = figure(history, "C0Y")
    assert np.isnan(one.trend.level) and with_expanded(1.2e-7, 2e-7, 1e6) in now_words(one)
    assert main(["history", place.url, "m"]) == 0
    assert "(last)" in capsys.readouterr().out
    low, high = years_of_machine(history).axes[0].get_xlim()
    assert 2021.0 - 0.2 < low < 2021.0 < high < 2021.0 + 0.2


@pytest.mark.parametrize(
    ("text", "about"),
    [
        ("tolerances:\n  C0Y: none\n", "C0Y"),
        ("tolerances:\n  C0Y: -1.0\n", "C0Y"),
        ("tolerances:\n  lathe: {C0Y: true}\n", "C0Y"),
        ("tolerances:\n  C0Y: [1.0]\n", "C0Y"),
        ("scales:\n  L1: .inf\n", "L1"),
        ("scales: 3\n", "scales"),
    ],
)
def test_what_is_stated_wrongly_is_refused(place, tmp_path, text, about):
    state(place, text, tmp_path)
    with refused(Refusal, "malformed", about=about, where=f"{place.url}/{FILE}"):
        read(place)


@pytest.mark.parametrize(
    ("text", "fault", "about"),
    [
        ("tolerances: {largest in volume: 25}\n", "out_of_range", "largest in volume"),
        ("tolerances:\n  mill: {C0Y: 30}\n", "out_of_range", "C0Y"),
        ("scales: {SN: 2}\n", "out_of_range", "SN"),
        ("tolerances: {largest in volum: 2.5e-5}\n", "unknown", "largest in volum"),
        ("tolerances:\n  mill: {C0X: 3e-5}\n", "unknown", "C0X"),
    ],
)
def test_what_cannot_be_a_tolerance_is_refused(place, tmp_path, text, fault, about):
    state(place, text, tmp_path)
    with refused(Refusal, fault, about=about, where=f"{place.url}/{FILE}"):
        read(place)


def test_a_tolerance_may_be_stated_before_its_figure_is_measured(place, tmp_path):
    limits = "angular E_AX: 3e-5, 'growth of X: rise': 30, diagonal ppn: 5e-3"
    state(place, f"tolerances: {{{limits}, C0Y: 1.0e-2}}\nscales: {{SN: 1.0e-3}}\n", tmp_path)
    assert figure(read(place)["new"], "C0Y").tolerance == 1e-2


def test_one_screen_for_all_and_one_for_a_machine(place, tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    state(place, "machines:\n  mill (old): mill\ntolerances:\n  C0Y: 4.0e-5\n", tmp_path)
    assert main(["history", place.url]) == 0
    out = capsys.readouterr().out
    assert max(map(len, out.splitlines())) <= 80 and len(out.splitlines()) <= 24
    assert out.index("lathe") < out.index("mill") and out.index("lathe") < out.index("new")
    assert main(["history", place.url, "mill"]) == 0
    out = capsys.readouterr().out
    table, rest = out.split("newest first")
    assert max(map(len, table.splitlines())) <= 80
    assert "C0Y" in rest and "E_n" in rest and "unknown" not in table


def test_json_holds_what_is_known_and_null_for_the_rest(place, capsys):
    assert main(["history", place.url, "--json"]) == 0
    found = {one["name"]: one for one in json.loads(capsys.readouterr().out)["machines"]}
    new = found["new"]["figures"][0]
    assert new["other_boxes"] == 0
    assert new["unknown"] == "runs" and new["level"] is None and new["limits"] == [None, None]
    assert found["lathe"]["figures"][0]["level_expanded_uncertainty"] > 0.0
    assert len(found["mill"]["figures"][0]["line"]) == found["mill"]["runs"]


def test_the_picture_is_written_once(place, tmp_path):
    for name, begins in (("a.png", b"\x89PNG"), ("a.svg", b"<?xml")):
        path = tmp_path / name
        told = ["history", place.url, "lathe", "--picture", str(path)]
        assert main(told) == 0 and path.read_bytes().startswith(begins)
        before = path.read_bytes()
        assert main(told) == 1 and path.read_bytes() == before
        assert main([*told, "--force"]) == 0
    assert main(["history", place.url, "lathe", "--picture", str(tmp_path / "a.bmp")]) == 1
    assert main(["history", place.url, "--picture", str(tmp_path / "b.png")]) == 1
    assert {one.name for one in tmp_path.iterdir()} == {"a.png", "a.svg"}


def test_what_is_not_there_is_refused(place, tmp_path, capsys, monkeypatch):
    with refused(Refusal, "not_found", "lathe", "mill", "new", about="nobody"):
        read(place, "nobody")
    assert main(["history", str(tmp_path / "nowhere")]) == 1
    assert main(["history", place.url, "nobody", "--json"]) == 1
    assert not capsys.readouterr().out
    find = importlib.util.find_spec
    monkeypatch.setattr(
        "stepdiag_ros.archive.find_spec", lambda name: None if name == "duckdb" else find(name)
    )
    assert main(["history", place.url]) == 1
    assert "duckdb" in capsys.readouterr().err


def test_the_sealed_machines_are_read_right(monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "benchmarks"))
    import history

    seeds = [history.measured(seed, machines=10) for seed in (101, 102, 103)]
    total = {
        name: sum(one[name] for one in seeds)
        for name in ("changes", "found_within_two_runs", "false_alarms_per_machine_and_decade")
    }
    assert total["found_within_two_runs"] >= 0.9 * total["changes"] > 20
    assert total["false_alarms_per_machine_and_decade"] <= len(seeds)
    holds, judged = np.sum([one["holds, judged, all"]["INTERVAL"][:2] for one in seeds], axis=0)
    # 90 % of some 50 intervals; the number that holds varies by 2.
    assert 0.8 * judged <= holds and judged > 20
