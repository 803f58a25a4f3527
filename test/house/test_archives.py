"""What a release is made of: the source archive, and the package that is built out of it."""

import shutil
import subprocess
import sys
import tarfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
GENERATED = ("PKG-INFO", "setup.cfg", "stepdiag_ros.egg-info")
"""What setuptools adds to a source archive."""
SHARED = ("action", "config", "msg")
"""Folders in the root that an installed package has in ``share``."""


def run(folder, *command):
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def files_in(folder):
    """Return the files in a folder and below it, without what Python compiled."""
    names = {path.relative_to(folder) for path in folder.rglob("*") if path.is_file()}
    return {name.as_posix() for name in names if "__pycache__" not in name.parts}


@pytest.fixture(scope="module")
def held():
    """Return the files that git holds, as far as they are still there."""
    if not (ROOT / ".git").exists():
        pytest.skip("this is a source archive: only git tells what should be in it")
    names = run(ROOT, "git", "ls-files", "-z").split("\0")
    return {name for name in names if (ROOT / name).is_file()}


@pytest.fixture(scope="module")
def archive(held, tmp_path_factory):
    """Return the unpacked source archive; the tree that it is built of has no git."""
    folder = tmp_path_factory.mktemp("release")
    for name in held:
        copy = folder / "tree" / name
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, copy)
    build = f"from setuptools.build_meta import build_sdist; build_sdist({str(folder)!r})"
    run(folder / "tree", sys.executable, "-c", build)
    (packed,) = folder.glob("*.tar.gz")
    with tarfile.open(packed) as opened:
        opened.extractall(folder, filter="data")
    return folder / packed.name.removesuffix(".tar.gz")


def test_a_source_archive_holds_what_git_holds(held, archive):
    """Also tests, pages and ``requirements.lock``: both commands of the README need them."""
    there = {name for name in files_in(archive) if not name.startswith(GENERATED)}
    assert there == held


def test_the_package_built_of_it_holds_its_code_and_every_file_that_it_reads(archive, held):
    built = archive.parent / "built"
    run(archive, sys.executable, "setup.py", "-q", "build_py", "--build-lib", str(built))
    code = {name for name in held if name.startswith("stepdiag_ros/")}
    beside = {f"stepdiag_ros/share/{name}" for name in held if name.partition("/")[0] in SHARED}
    assert files_in(built) == code | beside
