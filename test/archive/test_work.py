"""Adding, bringing up to date and verifying: whatever is given, and whenever somebody is killed."""

import multiprocessing
import os
import random
import shutil
import time
from datetime import timedelta
from pathlib import Path

import archive_runs
import pytest
from archive_runs import add_made_up, made_up, rows_made_up, write_bag
from refused import refused

from stepdiag_ros.archive import catalogue, work
from stepdiag_ros.archive.catalogue import Catalogue, part_of_bag, write_part
from stepdiag_ros.archive.engine import Engine
from stepdiag_ros.archive.place import Place
from stepdiag_ros.bags.seal import new_key, seal
from stepdiag_ros.metrology.refusal import Refusal

HERE = Engine(workers=1)
AT_ONCE = timedelta(seconds=-60)
"""What was replaced is removed without waiting for readers."""


@pytest.fixture
def bags(tmp_path):
    """Return bags whose content is made up, in a folder."""
    (tmp_path / "bags").mkdir()
    paths = [tmp_path / "bags" / f"{number}.mcap" for number in range(6)]
    for number, path in enumerate(paths):
        path.write_bytes(b"bag %d" % number)
    return paths


@pytest.fixture
def no_solving(monkeypatch):
    """Make rows up in place of solving."""
    monkeypatch.setattr(work, "rows_of_bag", rows_made_up)


def added(place, paths):
    return list(work.add(place, paths, HERE))


def wrong(place):
    return work.verify(place, lambda *_: None)


@pytest.mark.usefixtures("no_solving")
def test_what_is_added_once_more_is_left_as_it_is(place, bags):
    assert [one.evaluated for one in added(place, bags)] == [True] * 6
    names = place.names("")
    again = added(place, bags)
    assert [(one.evaluated, one.same_as) for one in again] == [(False, bag.name) for bag in bags]
    assert place.names("") == names and wrong(place) == []


@pytest.mark.usefixtures("no_solving")
def test_a_bag_under_two_names_is_kept_once_and_a_folder_is_gone_through(folder, bags):
    twin = shutil.copy(bags[0], bags[0].parent / "twin.mcap")
    outcomes = added(folder, work.bags_below([bags[0].parent]))
    assert [one.file for one in outcomes if one.same_as == bags[0].name] == [twin and str(twin)]
    assert len(folder.names("bags")) == 6 and wrong(folder) == []


@pytest.mark.usefixtures("no_solving")
def test_what_is_no_bag_is_refused_and_the_rest_goes_on(folder, bags, tmp_path):
    split = tmp_path / "split"
    split.mkdir()
    for name in ("a_0.mcap", "a_1.mcap", "metadata.yaml"):
        (split / name).write_text(name)
    note = tmp_path / "note.txt"
    note.write_text("no bag")
    outcomes = added(folder, [note, bags[0], *work.bags_below([split]), bags[1]])
    assert [Path(one.file).name for one in outcomes if one.problem] == [
        "note.txt", "a_0.mcap", "a_1.mcap",
    ]  # fmt: skip
    assert sorted(one.file for one in outcomes if one.evaluated) == ["0.mcap", "1.mcap"]
    for path in (tmp_path / "nowhere", tmp_path / "bags" / "empty"):
        path.name == "empty" and path.mkdir()
        with refused(Refusal, "not_found", where=str(path)):
            work.bags_below([path])


@pytest.mark.usefixtures("no_solving")
def test_a_seal_goes_with_its_bag(folder, bags, tmp_path):
    new_key(tmp_path / "key")
    seal(bags[0], tmp_path / "key")
    added(folder, bags[:1])
    (name,) = work.bags_of(folder).values()
    assert folder.exists(f"{name}.sig") and wrong(folder) == []


@pytest.mark.usefixtures("no_solving")
def test_the_catalogue_can_be_made_anew_to_the_byte(folder, bags):
    added(folder, bags)
    names = folder.names("catalogue")
    before = [folder.read(name) for name in names]
    for name in names:
        folder.remove(name)
    number, outcomes = work.update(folder, HERE)
    assert number == len(list(outcomes)) == 6
    assert folder.names("catalogue") == names
    assert [folder.read(name) for name in names] == before
    assert work.update(folder, HERE)[0] == 0


@pytest.mark.usefixtures("no_solving")
def test_a_new_version_evaluates_all_anew(folder, bags, monkeypatch):
    added(folder, bags)
    for module in (work, catalogue, archive_runs):
        monkeypatch.setattr(module, "__version__", "99.0.0")
    number, outcomes = work.update(folder, HERE)
    assert number == len(list(outcomes)) == 6
    with Catalogue(folder) as opened:
        assert opened.ask("select distinct software_version from runs") == [
            {"software_version": "99.0.0"}
        ]
        assert len(opened.ask("select * from runs")) == 6
    with refused(Refusal, "mismatch", "0.0.1", "99.0.0", aspect="version"):
        work.evaluate_bag(folder.url, "0.0.1", "bags/x/x.mcap")


@pytest.mark.usefixtures("no_solving")
def test_of_another_version_of_the_catalogue_one_is_made_anew(folder, bags):
    added(folder, bags)
    for name in folder.names("catalogue"):
        folder.put(Path(folder.address(name)), name.replace("catalogue/1", "catalogue/0"))
        folder.remove(name)
    number, outcomes = work.update(folder, HERE)
    assert number == len(list(outcomes)) == 6 and wrong(folder) == []


@pytest.mark.usefixtures("no_solving")
def test_verify_names_every_fault(folder, bags, tmp_path):
    added(folder, bags)
    names = list(work.bags_of(folder).values())
    content = folder.read(names[0])
    (tmp_path / "x").write_bytes(b"changed")
    folder.put(tmp_path / "x", names[0])
    (fault,) = wrong(folder)
    assert names[0] in fault
    (tmp_path / "x").write_bytes(content)
    folder.put(tmp_path / "x", names[0])
    assert wrong(folder) == []
    folder.remove(names[1])
    (fault,) = wrong(folder)
    assert names[1].split("/")[1] in fault
    added(folder, bags)
    part = part_of_bag(names[2].split("/")[1])
    folder.remove(f"catalogue/1/runs/{part}.parquet")
    (fault,) = wrong(folder)
    assert names[2] in fault
    assert work.update(folder, HERE)[0] == 1 or list(work.update(folder, HERE)[1])


@pytest.mark.usefixtures("no_solving")
def test_verify_sees_a_part_that_lacks_a_file_and_a_run_that_lacks_rows(folder, bags):
    added(folder, bags[:2])
    sha256 = next(iter(work.bags_of(folder)))
    part = part_of_bag(sha256)
    folder.remove(f"catalogue/1/curves/{part}.parquet")
    (fault,) = wrong(folder)
    assert part in fault
    rows = made_up(sha256, part)
    rows.figures.pop()
    write_part(folder, part, rows)
    (fault,) = wrong(folder)
    assert rows.runs[0].run_id in fault


def in_process(place, bags, kept=AT_ONCE):
    """Return a process that has begun to add bags; it has imported everything already."""
    context = multiprocessing.get_context("forkserver")
    # Where pandas is installed, pyarrow imports it with the first table that it makes.
    context.set_forkserver_preload(["stepdiag_ros.archive.work", "pandas"])
    begun = context.Event()
    process = context.Process(target=add_made_up, args=(place.url, bags, kept, begun))
    process.start()
    assert begun.wait(120)
    return process


def test_computers_that_add_at_once_lose_and_double_nothing(folder, bags):
    kept = timedelta(minutes=1)
    at_once = [in_process(folder, some, kept) for some in (bags[:4], bags[2:], bags)]
    for process in at_once:
        process.join(120)
        assert process.exitcode == 0
    assert wrong(folder) == []
    with Catalogue(folder) as opened:
        assert len(opened.ask("select * from runs")) == len(work.bags_of(folder)) == 6


@pytest.mark.usefixtures("no_solving")
@pytest.mark.parametrize("moments", [5, 100], ids=["few", "many"])
def test_the_catalogue_is_whole_whenever_a_process_is_killed(folder, bags, tmp_path, moments):
    """Each round adds further bags, and packs, and is killed at a random moment of it."""
    chance = random.Random(4)
    for some in (bags[:2], bags[2:]):
        process = in_process(folder, some)
        started = time.monotonic()
        process.join(120)
        assert process.exitcode == 0
    longest = time.monotonic() - started
    known, moment = 6, 0
    while moment < moments or known == 6:
        moment += 1
        further = [tmp_path / f"{moment} {number}.mcap" for number in range(6)]
        for path in further:
            path.write_bytes(path.name.encode())
        process = in_process(folder, further)
        time.sleep(chance.uniform(0.0, longest))
        process.kill()
        process.join()
        with Catalogue(folder) as opened:
            assert opened.incomplete_parts() == [] and work._different(opened) == []
            found = [row["bag_sha256"] for row in opened.ask("select bag_sha256 from runs")]
        assert len(found) == len({*found}) >= known
        # A computer that is slower now than it was at first gets as far later.
        longest *= 1.0 if len(found) > known else 1.2
        known = len(found)
        assert {*found} <= {*work.bags_of(folder)}
    outcomes = list(work.update(folder, HERE)[1])
    assert not [one for one in outcomes if one.problem] and wrong(folder) == []


def test_rows_are_not_made_where_the_bag_changes_meanwhile(folder, bags, monkeypatch):
    put = Place.put

    def changed(self, source, name):
        put(self, source, name)
        source.write_bytes(b"more")

    monkeypatch.setattr(Place, "put", changed)
    (outcome,) = added(folder, bags[:1])
    assert outcome.problem and not outcome.evaluated
    assert work.bags_of(folder) == {}


@pytest.mark.usefixtures("no_solving")
def test_a_full_disk_is_told_and_leaves_nothing_behind(folder, bags, monkeypatch):
    def full(_):
        raise OSError(28, os.strerror(28))

    with monkeypatch.context() as patched:
        patched.setattr(os, "fsync", full)
        (outcome,) = added(folder, bags[:1])
    assert outcome.problem and not outcome.evaluated
    assert folder.names("") == []
    assert [one.evaluated for one in added(folder, bags[:1])] == [True]


def test_a_cut_bag_is_kept_with_its_problem(folder, tmp_path):
    whole = write_bag(tmp_path / "whole.mcap")
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole.read_bytes()[:-100])
    outcomes = added(folder, [whole, cut])
    assert [one.file for one in outcomes if one.problem] == ["whole.mcap", "cut.mcap"]
    with Catalogue(folder) as opened:
        found = {row["file"]: row for row in opened.ask("select * from runs")}
    assert "recover" in found["cut.mcap"]["problem"]
    assert found["whole.mcap"]["run_id"] and found["whole.mcap"]["machine"]
    assert wrong(folder) == []
