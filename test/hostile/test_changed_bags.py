"""Bags that were changed with every checksum right: seen, said first, and counted right."""

import json
import random
from dataclasses import replace

import attack
import pytest
from forging import as_older_recorders_wrote, taken_apart
from small_run import write_small_run

from stepdiag_ros.bags.recover import recover
from stepdiag_ros.bags.run import load_run
from stepdiag_ros.cli import main
from stepdiag_ros.evaluation.lead import lead_of
from stepdiag_ros.evaluation.recorded_run import report_of_run
from stepdiag_ros.report.documents.lead import lead_document
from stepdiag_ros.words.lead import sentences_of

READING, COMMAND, STOP = "/interferometer/reading", "/machine/command", "/measurement/stop"
RESULT = "/result/volumetric_errors"


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return write_small_run(tmp_path_factory.mktemp("whole") / "run.mcap")


@pytest.fixture
def written(tmp_path):
    def write(bag, name="changed.mcap"):
        path = tmp_path / name
        path.write_bytes(bag.encoded())
        return path

    return write


def solved(path):
    return report_of_run(load_run(path))


def numbers(report):
    return {
        one.method: [curve.tobytes() for curve in one.curves.values()] for one in report.results
    }


def kinds(path):
    return {flaw.kind for flaw in load_run(path).flaws}


def test_a_bag_that_nobody_has_changed_has_no_flaw(whole):
    assert load_run(whole).flaws == ()
    assert lead_document(lead_of(solved(whole)))["recording"] == []


@pytest.mark.parametrize("older", [False, True], ids=["numbered", "older"])
def test_every_chunk_doubled_is_said_and_counts_once(whole, written, older):
    bag = taken_apart(whole)
    bag = as_older_recorders_wrote(bag) if older else bag
    known = numbers(solved(written(bag, "once.mcap")))
    for number in range(len(bag.chunks)):
        changed = replace(bag, chunks=[*bag.chunks, bag.chunks[number]])
        path = written(changed)
        report = solved(path)
        assert numbers(report) == known
        doubled = [one for one in report.recording if one.kind == "doubled"]
        # How often a solver published its results, nobody but our writer tells.
        if older and {one.channel_id for one in bag.chunks[number]} == {bag.channel_of(RESULT)}:
            assert not doubled
            continue
        (flaw,) = doubled
        there = [one for one in bag.chunks[number] if one.channel_id == bag.channel_of(READING)]
        assert flaw.messages.get(READING, 0) == len(there)
        assert sentences_of(lead_of(report))[0] == flaw.sentence


@pytest.mark.parametrize("older", [False, True], ids=["numbered", "older"])
def test_every_chunk_dropped_is_said_first(whole, written, older):
    bag = taken_apart(whole)
    bag = as_older_recorders_wrote(bag) if older else bag
    for number in range(1, len(bag.chunks)):
        path = written(replace(bag, chunks=bag.chunks[:number] + bag.chunks[number + 1 :]))
        run = load_run(path)
        assert "missing" in kinds(path), number
        there = [one for one in bag.chunks[number] if one.channel_id == bag.channel_of(READING)]
        # Of the readings behind the last stop nobody but our writer tells how many there were.
        behind = {one.channel_id for chunk in bag.chunks[number + 1 :] for one in chunk}
        known = not older or bag.channel_of(READING) in behind
        if there and known:
            assert sum(flaw.messages.get(READING, 0) for flaw in run.flaws) == len(there)


def test_a_reading_that_its_sequence_promises_is_missed_by_every_command(whole, written, capsys):
    bag = as_older_recorders_wrote(taken_apart(whole))
    number, place = bag.places(READING)[200]
    del bag.chunks[number][place]
    path = written(bag)
    assert main(["solve", str(path), "--json", "--pictures", "none"]) == 0
    lead = json.loads(capsys.readouterr().out)["lead"]
    (flaw,) = [one for one in lead["recording"] if one["kind"] == "missing"]
    assert flaw["messages"] == {READING: 1}
    assert lead["sentences"][0] == flaw["sentence"]
    assert not any("compensate" in (one["command"] or "") for one in lead["next"])
    for command in ("diagnose", "budget", "iso230"):
        main([command, str(path), "--pictures", "none", "--output", str(path.parent / command)])
        assert flaw["sentence"] in capsys.readouterr().err, command


def test_the_end_of_a_run_that_has_all_its_lines_is_missed(whole, written):
    bag = as_older_recorders_wrote(taken_apart(whole))
    number, place = bag.places("/run/state")[-1]
    del bag.chunks[number][place]
    (flaw,) = load_run(written(bag)).flaws
    assert (flaw.kind, flaw.messages) == ("missing", {"/run/state": 1})


@pytest.mark.parametrize("topic", [COMMAND, STOP, "/machine/command_status", "/measurement/block"])
def test_events_that_others_promise_are_missed_in_bags_of_older_recorders(whole, written, topic):
    bag = as_older_recorders_wrote(taken_apart(whole))
    number, place = bag.places(topic)[len(bag.places(topic)) // 2]
    if topic.endswith("status"):  # of three words on a move only the last is promised
        places = bag.places(topic)
        number, place = places[3 * (len(places) // 6) + 2]
    del bag.chunks[number][place]
    (flaw,) = [one for one in load_run(written(bag)).flaws if topic in one.messages]
    assert (flaw.kind, flaw.messages[topic]) == ("missing", 1)


def test_chunks_in_another_order_give_the_same_numbers_and_a_word(whole, written):
    bag = taken_apart(whole)
    known = numbers(solved(whole))
    random.Random(4).shuffle(bag.chunks)
    report = solved(written(bag))
    assert numbers(report) == known
    assert {flaw.kind for flaw in report.recording} == {"out_of_order"}


def test_statistics_that_count_more_are_believed(whole, written):
    bag = as_older_recorders_wrote(taken_apart(whole))
    bag.lies.statistics = bag.counted()
    number = next(n for n, chunk in enumerate(bag.chunks) if len(chunk) > 2)
    lost = bag.chunks[number].pop()
    (flaw, *_) = load_run(written(bag)).flaws
    assert flaw.messages == {bag.channels[lost.channel_id].topic: 1}


def test_a_recovered_bag_counts_doubled_messages_once_and_tells_what_it_lacks(whole, written):
    bag = taken_apart(whole)
    known = numbers(solved(whole))
    doubled = written(replace(bag, chunks=bag.chunks * 2), "doubled.mcap")
    clean = doubled.with_name("clean.mcap")
    report = recover(doubled, clean)
    assert report.messages == sum(len(chunk) for chunk in bag.chunks)
    assert report.losses
    again = solved(clean)
    assert numbers(again) == known
    assert {flaw.kind for flaw in again.recording} == {"recovered"}

    lacking = written(replace(bag, chunks=bag.chunks[:3] + bag.chunks[5:]), "lacking.mcap")
    report = recover(lacking, lacking.with_name("rest.mcap"))
    assert report.messages_lost == len(bag.chunks[3]) + len(bag.chunks[4])
    assert kinds(lacking.with_name("rest.mcap")) >= {"recovered", "missing"}


def test_a_recording_that_was_cut_off_stays_usable_after_recovery(whole, tmp_path):
    cut = tmp_path / "cut.mcap"
    content = whole.read_bytes()
    cut.write_bytes(content[: len(content) * 2 // 3])
    recover(cut, tmp_path / "rest.mcap")
    report = solved(tmp_path / "rest.mcap")
    assert report.recording[0].kind == "recovered"
    assert report.measurement.lines


@pytest.mark.parametrize("cases", [5, 50], ids=["few", "many"])
def test_no_case_of_the_quick_attack_fails(tmp_path, cases):
    (tmp_path / "whole").mkdir()
    begun, tally = attack.Attack(tmp_path), attack.Tally()
    for number in range(cases):
        begun.run(20, number, tally)
    assert tally.faults == []
    assert tally.cases >= 0.9 * cases
