"""A bag at a glance."""

import pytest
from bags_for_tests import (
    READING,
    RUN_ID,
    START,
    description,
    header,
    put,
    reading_cdr,
    write_readings,
)
from refused import refused
from test_run import state, write_run

from stepdiag_ros import schemas, topics
from stepdiag_ros.bags.errors import BagError
from stepdiag_ros.bags.info import bag_info
from stepdiag_ros.bags.writer import BagWriter
from stepdiag_ros.cli import main


def test_a_whole_bag(tmp_path):
    path = write_run(tmp_path / "a.mcap")
    info = bag_info(path)
    assert (info.complete, info.intact, info.problem, info.gaps) == (True, True, "", [])
    assert info.header.run_id == RUN_ID
    assert info.topics[READING] == (topics.READING.type_name, 3)
    assert info.messages == sum(count for _, count in info.topics.values()) > 30
    assert info.lines == ["x forward, repeat 0"] * 2
    assert info.size == path.stat().st_size
    assert info.data_checksum
    plain = schemas.plain(info.document())
    assert plain["run"]["run_id"] == RUN_ID
    assert plain["attachments"] == ["plan.yaml", "machine.yaml", "parameters.yaml", "note.txt"]


@pytest.mark.parametrize(("code", "words"), [(6, "fault"), (5, "operator"), (1, "before the run")])
def test_a_whole_bag_of_a_run_that_has_failed_says_how_it_ended(
    tmp_path, capsys, monkeypatch, code, words
):
    path = tmp_path / "a.mcap"
    with BagWriter(path, header()) as bag:
        put(bag, topics.RUN_DESCRIPTION, description(), START)
        for number, value in enumerate((1, code)):
            told = state(value, "no beam", START + number)
            told.stops_done, told.stops_total = 3, 748
            put(bag, topics.RUN_STATE, told, START)
    (run,) = bag_info(path).document().runs
    assert words in run.end and "no beam" in run.end
    assert (run.stops_done, run.stops_total) == (3, 748)
    assert main(["info", str(path)]) == 0
    said = capsys.readouterr().out
    assert f"{run.end} (3 of 748 stops)" in said
    monkeypatch.chdir(tmp_path)
    assert main(["info"]) == 0
    assert run.end in capsys.readouterr().err


def test_missing_readings_are_found(tmp_path):
    path = tmp_path / "a.mcap"
    numbers = [0, 1, 2, 5, 6, 20]
    with BagWriter(path, header()) as bag:
        for number in numbers:
            bag.write(READING, topics.READING.type_name, reading_cdr(number), START)
    info = bag_info(path)
    assert [(gap.after, gap.before, gap.missing) for gap in info.gaps] == [(2, 5, 2), (6, 20, 13)]
    assert info.gaps[0].time == START + 5_000_000
    assert info.document().missing_readings == 15


def test_an_instrument_that_was_started_again_misses_an_unknown_number_never_a_negative_one(
    tmp_path, capsys
):
    path = tmp_path / "a.mcap"
    with BagWriter(path, header()) as bag:
        for number in (7, 8, 10, 0, 1):
            bag.write(READING, topics.READING.type_name, reading_cdr(number), START)
    info = bag_info(path)
    assert [(gap.after, gap.before, gap.missing) for gap in info.gaps] == [(8, 10, 1), (10, 0, 0)]
    assert info.document().missing_readings == 1
    main(["info", str(path)])
    said = capsys.readouterr().out
    assert "8 to 10" in said and "10 to 0" in said and "unknown" in said


def test_a_cut_bag_says_so_instead_of_failing(tmp_path):
    path = write_readings(tmp_path / "a.mcap", 100)
    path.write_bytes(path.read_bytes()[:-50])
    info = bag_info(path)
    assert (info.complete, info.intact) == (False, None)
    assert "stepdiag recover" in info.problem


def test_a_damaged_bag_says_so_instead_of_failing(tmp_path):
    path = write_readings(tmp_path / "a.mcap", 100, compress=False)
    bad = bytearray(path.read_bytes())
    bad[bad.index(reading_cdr(50)) + 30] ^= 1
    path.write_bytes(bad)
    info = bag_info(path)
    assert (info.complete, info.intact) == (True, False)
    assert "damaged" in info.problem


def test_a_folder_without_a_name_is_no_bag(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with refused(BagError, "wrong_kind"):
        bag_info(".")


def test_what_is_no_bag_is_an_error(tmp_path):
    with refused(BagError, "not_found", "a.mcap"):
        bag_info(tmp_path / "a.mcap")
