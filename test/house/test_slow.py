"""Which slow tests a change concerns."""

import subprocess
from pathlib import Path

import pytest
import slow

TEST = Path(__file__).parents[1]


@pytest.mark.parametrize(
    ("path", "folder"),
    [
        ("stepdiag_ros/metrology/solvers/linear.py", "metrology/solvers"),
        ("test/metrology/test_coverage.py", "metrology"),
        ("benchmarks/felt.py", "benchmarks"),
        ("README.md", "docs"),
        ("docs/how_to/watch.md", "docs"),
        ("stepdiag_ros/topics.py", ""),
        ("setup.py", ""),
    ],
)
def test_a_file_is_in_a_folder_of_the_package_or_of_the_root(path, folder):
    assert slow.folder_of(path) == folder


@pytest.mark.parametrize(
    ("judged", "changed", "concerned"),
    [
        (["metrology"], ["stepdiag_ros/metrology/solvers/linear.py"], True),
        (["metrology/solvers"], ["stepdiag_ros/metrology/plan.py"], False),
        (["metro"], ["stepdiag_ros/metrology/plan.py"], False),
        (["bags"], ["test/bags/test_recover.py"], True),
        (["bags", "run"], ["stepdiag_ros/viewers/terminal/page.py", "docs/watch.md"], False),
        (["bags"], ["stepdiag_ros/viewers/terminal/page.py", "requirements.lock"], True),
        (["bags"], ["config/plans/demo.yaml"], True),
        (slow.EVERY, ["docs/watch.md"], True),
        (slow.EVERY, [], False),
    ],
)
def test_a_test_is_concerned_by_its_folders_and_by_what_all_share(judged, changed, concerned):
    assert slow.is_concerned(judged, changed) == concerned


def test_a_slow_test_judges_its_own_folder_too():
    name = "metrology/tracker/test_tracker_coverage.py::test_no_band_is_false::many"
    assert slow.folders_judged(name) == {"metrology"}
    assert slow.folders_judged(name.replace("many", "few")) is None
    closed_loop = slow.folders_judged("linuxcnc/test_closed_loop.py::test_any")
    assert closed_loop is not None and closed_loop > {"linuxcnc", "devices"}


def test_every_folder_that_a_slow_test_judges_is_there():
    root = TEST.parent
    for pattern, folders in slow.SLOW.items():
        module = pattern.partition("::")[0].rstrip("*")
        assert not module or (TEST / module).is_file(), pattern
        for folder in folders:
            places = (root / "stepdiag_ros" / folder, TEST / folder, root / folder)
            assert any(place.is_dir() for place in places), folder


@pytest.fixture
def repository(tmp_path):
    def git(*words):
        who = ("-c", "user.name=a", "-c", "user.email=a@b.c")
        return subprocess.run(["git", *who, *words], cwd=tmp_path, check=True, capture_output=True)

    git("init", "-q")
    (tmp_path / "a.py").write_text("1\n")
    (tmp_path / "b.py").write_text("1\n")
    git("add", ".")
    git("commit", "-q", "-m", "first")
    return tmp_path


def test_what_differs_from_a_commit_is_what_git_says(repository):
    assert slow.changed_since("HEAD", repository) == []
    (repository / "b.py").write_text("2\n")
    assert slow.changed_since("HEAD", repository) == ["b.py"]


def test_where_git_cannot_tell_nothing_is_left_out(repository, tmp_path_factory, monkeypatch):
    assert slow.changed_since("no_such_commit", repository) is None
    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(tmp_path_factory.getbasetemp()))
    assert slow.changed_since("HEAD", tmp_path_factory.mktemp("no_repository")) is None
