"""The catalogue: what counts in it, whatever was written, packed, killed or stated."""

from datetime import datetime, timedelta, timezone

import pandas
import polars
import pytest
from archive_runs import BEGAN, FIGURES, digest, filled, made_up
from refused import refused

from stepdiag_ros.archive import catalogue
from stepdiag_ros.archive.catalogue import Catalogue, part_of_bag, tidy, write_part
from stepdiag_ros.archive.columns import TABLES, described, schema
from stepdiag_ros.archive.stated import FILE
from stepdiag_ros.metrology.refusal import Refusal


def rows(place, table="runs"):
    """Return all rows but for the part that they are in, in an order of their own."""
    with Catalogue(place) as opened:
        found = opened.ask(f"select * exclude (part) from {table}")
    return sorted(found, key=lambda row: (row["bag_sha256"], row.get("name") or ""))


def test_what_is_written_is_read_from_every_kind_of_place(place):
    filled(place, range(3))
    numbers = {digest(number): int(digest(number)[:6], 16) * 1e-12 for number in range(3)}
    found = rows(place)
    assert {row["bag_sha256"]: row["largest_m"] for row in found} == numbers
    assert {row["time"] for row in found} == {row["start_time"] for row in found}
    figures, curves = rows(place, "figures"), rows(place, "curves")
    assert [row["name"] for row in figures] == [*FIGURES] * 3
    assert [row["value"] for row in curves] == [[0.0, None]] * 3
    ago = [datetime.now(timezone.utc) - place.written(name) for name in place.names("catalogue")]
    assert len(ago) == 9 and all(abs(one) < timedelta(minutes=10) for one in ago)


def test_pandas_and_polars_read_the_files(folder, tmp_path):
    filled(folder, range(3))
    root = tmp_path / "an archive" / "catalogue" / "1"
    for table in TABLES:
        expected = {row["bag_sha256"] for row in rows(folder, table)}
        by_pandas = pandas.read_parquet(root / table)
        by_polars = polars.read_parquet(root / table / "*.parquet")
        assert {*by_pandas["bag_sha256"]} == {*by_polars["bag_sha256"]} == expected
        assert list(by_pandas.columns) == by_polars.columns == list(described(table))
    assert by_polars.schema["start_time"] == polars.Datetime("us", "UTC")


def test_each_column_states_what_it_means_in_the_file_too():
    for table in TABLES:
        told = {name: meaning for name, (_, meaning) in described(table).items()}
        made = {one.name: one.metadata[b"description"].decode() for one in schema(table)}
        assert made == told and all(told.values())


def test_a_part_that_is_written_again_is_the_same_to_the_byte(folder):
    filled(folder, [1])
    names = folder.names("catalogue")
    before = [folder.read(name) for name in names]
    filled(folder, [1])
    assert folder.names("catalogue") == names
    assert [folder.read(name) for name in names] == before


def test_the_newest_software_counts_and_the_older_rows_go(folder):
    filled(folder, range(3), software_version="0.9.0", plan="old")
    filled(folder, range(2), software_version="0.10.0", plan="new", run_id="R")
    expected = {digest(0): "new", digest(1): "new", digest(2): "old"}

    def plans():
        assert [row["run_id"] for row in rows(folder, "figures")].count("R") == 4
        return {row["bag_sha256"]: row["plan"] for row in rows(folder)}

    assert plans() == expected
    before = rows(folder), rows(folder, "figures"), rows(folder, "curves")
    tidy(folder)
    assert (rows(folder), rows(folder, "figures"), rows(folder, "curves")) == before
    with Catalogue(folder) as opened:
        assert not opened.twice and len(opened.parts) == 2


@pytest.mark.parametrize("stops_after", [0, 1, 3, 4, 9, 19])
def test_packing_changes_no_row_wherever_it_stops(folder, monkeypatch, stops_after):
    monkeypatch.setattr(catalogue, "FEW", 3)
    monkeypatch.setattr(catalogue, "KEPT", timedelta(seconds=-60))
    filled(folder, range(5))
    before = [rows(folder, table) for table in TABLES]
    steps = []

    def stopping(do):
        def step(*values):
            if len(steps) == stops_after:
                raise KeyboardInterrupt
            steps.append(values)
            do(*values)

        return step

    with monkeypatch.context() as patched, pytest.raises(KeyboardInterrupt):
        patched.setattr(folder, "put", stopping(folder.put))
        patched.setattr(folder, "remove", stopping(folder.remove))
        tidy(folder)
        assert [rows(folder, table) for table in TABLES] == before
        tidy(folder)
    assert [rows(folder, table) for table in TABLES] == before
    for _ in range(2):
        tidy(folder)
        assert [rows(folder, table) for table in TABLES] == before
    monkeypatch.setattr(catalogue, "UNFINISHED", timedelta(seconds=-60))
    tidy(folder)
    assert len(folder.names("catalogue")) == len(TABLES)


def test_who_reads_while_others_pack_can_end(folder):
    filled(folder, range(3))
    with Catalogue(folder) as opened:
        with Catalogue(folder) as other:
            other.pack(other.parts)
        tidy(folder)
        assert len(opened.ask("select * from figures")) == 3 * len(FIGURES)
    with Catalogue(folder) as opened:
        assert len(opened.parts) == 1 and not opened.twice


def test_small_parts_are_packed_into_larger_ones_and_those_too(folder, monkeypatch):
    monkeypatch.setattr(catalogue, "FEW", 3)
    for number in range(27):
        filled(folder, [number])
        tidy(folder)
    with Catalogue(folder) as opened:
        sizes = [int(part.partition("-")[0]) for part in opened.parts]
        assert sum(sizes) == 27 and max(sizes) == 9 and len(sizes) <= 6
        assert len(rows(folder)) == 27


def test_packed_rows_stand_in_one_order_however_their_parts_came(folder):
    filled(folder, range(4), start_time=BEGAN, machine="one machine", run_id="one run")

    def packed(order):
        with Catalogue(folder) as opened:
            part = opened.pack(sorted(opened.parts)[::order])
        with Catalogue(folder) as opened:
            assert opened.parts == [part]
            found = [opened.ask(f"select * exclude (part) from rows_{table}") for table in TABLES]
        assert len(found[0]) == 4
        for name in folder.names("catalogue"):
            if part in name:
                folder.remove(name)
        return found

    assert packed(1) == packed(-1)


def test_two_that_pack_at_once_leave_each_row_once(folder):
    filled(folder, range(4))
    with Catalogue(folder) as one, Catalogue(folder) as other:
        other.pack(other.parts)
        one.pack(one.parts[:3])
    with Catalogue(folder) as opened:
        assert opened.twice
    tidy(folder)
    with Catalogue(folder) as opened:
        assert not opened.twice and len(opened.parts) == 1
    assert {row["bag_sha256"] for row in rows(folder)} == {digest(one) for one in range(4)}
    assert len(rows(folder, "figures")) == 4 * len(FIGURES)


def test_what_was_never_finished_is_not_seen_and_goes_after_a_day(folder, monkeypatch):
    filled(folder, [1])
    part = part_of_bag(digest(2))
    write_part(folder, part, made_up(digest(2), part))
    folder.remove(f"catalogue/1/runs/{part}.parquet")
    assert {row["bag_sha256"] for row in rows(folder, "figures")} == {digest(1)}
    tidy(folder)
    assert len(folder.names("catalogue")) == 5
    monkeypatch.setattr(catalogue, "UNFINISHED", timedelta(seconds=-60))
    tidy(folder)
    assert len(folder.names("catalogue")) == 3 and len(rows(folder)) == 1


def state(place, tmp_path, text):
    """Write the file of the owner."""
    (tmp_path / FILE).write_text(text)
    place.put(tmp_path / FILE, FILE)


def test_the_owner_renames_machines_and_puts_clocks_right(folder, tmp_path):
    future = datetime.now(timezone.utc) + timedelta(days=400)
    filled(folder, [1], machine="VMC", start_time=future, run_id="R1")
    filled(folder, [2], machine="old", serial_number="S2", start_time=None)
    filled(folder, [3], machine="old", serial_number="S3")
    times = {row["bag_sha256"]: (row["time"], row["start_time"]) for row in rows(folder)}
    assert times[digest(1)] == (None, future) and times[digest(2)] == (None, None)
    text = f"machines: {{old: mill, S2: lathe}}\ntimes: {{R1: 2025-04-01T00:00:00Z, {digest(2)}: "
    state(folder, tmp_path, f"{text}2025-05-01T02:00:00+02:00}}\n")
    for table in TABLES:
        found = {row["bag_sha256"]: row for row in rows(folder, table)}
        names = [(found[digest(one)]["machine"], found[digest(one)]["machine_stated"]) for one in
                 (1, 2, 3)]  # fmt: skip
        assert names == [("VMC", "VMC"), ("lathe", "old"), ("mill", "old")]
        began = [found[digest(one)]["time"] for one in (1, 2)]
        assert [f"{one:%Y-%m-%d}" for one in began] == ["2025-04-01", "2025-05-01"]
    assert found[digest(3)]["time"] == found[digest(3)]["start_time"] > BEGAN


@pytest.mark.parametrize(
    ("text", "fault", "names"),
    [
        ("machine: {}", "unknown", ["machines", "times"]),
        ("machines: [a]", "malformed", ["machines"]),
        ("machines: {a: b, b: c}", "malformed", ["a", "b"]),
        ("machines: {a: 3}", "malformed", ["a"]),
        ("times: {R: yesterday}", "malformed", ["R", "yesterday"]),
        ("times: {R: 2025-01-01T00:00:00}", "malformed", ["R"]),
    ],
)
def test_a_malformed_file_of_the_owner_is_refused(folder, tmp_path, text, fault, names):
    filled(folder, [1])
    state(folder, tmp_path, text)
    with refused(Refusal, fault, FILE, *names):
        Catalogue(folder)


def test_another_version_of_the_catalogue_is_named_and_left_alone(folder, tmp_path):
    (tmp_path / "x").write_text("of an older program")
    folder.put(tmp_path / "x", "catalogue/0/runs/1-x.parquet")
    with refused(Refusal, "mismatch", "0", "1", aspect="catalogue"):
        Catalogue(folder)
    filled(folder, [1])
    assert len(rows(folder)) == 1
    assert folder.exists("catalogue/0/runs/1-x.parquet")


def test_a_place_without_a_catalogue_is_refused(folder):
    with refused(Refusal, "missing", "archive", aspect="catalogue"):
        Catalogue(folder)


def test_a_damaged_part_and_a_wrong_query_are_told_in_a_sentence(folder, tmp_path):
    filled(folder, [1])
    with Catalogue(folder) as opened, refused(Refusal, "failed", "nothing"):
        opened.ask("select nothing from runs")
    (tmp_path / "x").write_bytes(b"PAR1 cut")
    folder.put(tmp_path / "x", "catalogue/1/runs/1-00.parquet")
    with refused(Refusal, "failed", "1-00.parquet"):
        Catalogue(folder)
