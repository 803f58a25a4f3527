"""Which tests are live, and what holds around every test: threads, signals, JSON and its schema."""

import gc
import importlib
import os
import signal
import subprocess
import sys
from contextlib import suppress
from functools import cache
from pathlib import Path
from unittest import mock

import jsonschema_rs
import pytest
import scipy.linalg  # noqa: F401 - brings a library of its own, to be limited below
import slow
from domains import own_domain, room_for_a_cell
from forked import ForkedPopen
from hypothesis import settings
from threadpoolctl import ThreadpoolController

import stepdiag_ros.client  # noqa: F401 - makes rclpy importable
from stepdiag_ros import schemas

# How long an example takes says how busy the computer is. The same examples every time: a change
# fails by what it changes, never by chance. ``--hypothesis-profile fresh`` looks for new ones.
settings.register_profile("same examples", deadline=None, derandomize=True)
settings.register_profile("fresh", deadline=None, derandomize=False, max_examples=1000)
settings.load_profile("same examples")

LIVE = (
    "campaign",
    "conformance",
    "devices/cnc_peers",
    "embedded",
    "examples",
    "interoperability",
    "linuxcnc",
    "nodes",
    "viewers/foxglove_live",
    "viewers/page_live",
    "viewers/terminal_live",
)
"""Where tests run nodes, controllers or peers in real time.

Each is in a ROS domain of its own, so that they may run beside each other.
"""
FIRST = (
    "linuxcnc",
    "devices/cnc_peers",
    "nodes/test_whole_run.py",
    "nodes/test_faults.py",
    "nodes",
    "viewers/page_live",
    "viewers/foxglove_live",
    "site",
    "blind",
    "house",
    "documents",
    "hostile",
    "metrology/test_coverage.py",
)
"""What takes longest begins first, so that no process is left alone with it at the end."""


def pytest_addoption(parser):
    """Add an option that picks slow tests by what a change touches."""
    parser.addoption(
        "--changed-since",
        metavar="COMMIT",
        help="of slow tests, only those that judge a folder which differs from this commit",
    )


def pytest_configure(config):
    """Keep the order of ``FIRST``; keep what was compiled, whatever the environment says.

    To rewrite the assertions of 300 modules takes twice as long as the rest of the collection, in
    every process that tests. A node would compile 200 modules as it starts, and live tests start a
    dozen nodes each.
    """
    config.option.loadscopereorder = False
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    sys.dont_write_bytecode = False


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers(config):
    """Run one process more than there are processors: quick live tests wait most of their time.

    The slow ones work most of theirs. With two more, the same tests take a quarter more processor
    time, since each finds its memory in no cache.
    """
    spare = 0 if config.option.markexpr == "slow" else 1
    return len(os.sched_getaffinity(0)) + spare


@pytest.hookimpl(tryfirst=True)
def pytest_collection(session):
    """Compile a share of all modules in each process, so that no process compiles all of them.

    What cannot be imported here fails again, and is reported, where it is collected.
    """
    here, config = Path(__file__).parent, session.config
    worker = getattr(config, "workerinput", None)
    if worker is None or [Path(one).resolve() for one in config.args] != [here]:
        return
    number, count = int(worker["workerid"].removeprefix("gw")), worker["workercount"]
    for path in sorted(here.rglob("test_*.py"))[number::count]:
        if str(path.parent) not in sys.path:
            sys.path.insert(0, str(path.parent))
        with suppress(Exception, pytest.skip.Exception):
            importlib.import_module(path.stem)


@cache
def is_in(path, places):
    """Return whether a file is one of these places in this folder, or in one of them."""
    here = Path(__file__).parent
    return any(path.is_relative_to(here / place) for place in places)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    """Mark live tests by where they are and slow ones by their names; mix them.

    Of live tests and of those that calculate what is long comes first. A live test needs its nodes
    to keep up, and waits for half of its time: it is best run beside one that calculates.
    """
    slow.select(config, items, Path(__file__).parents[1])
    for item in items:
        if is_in(item.path, LIVE):
            item.add_marker("live")
    order = (*FIRST, ".")
    items.sort(key=lambda item: next(n for n, one in enumerate(order) if is_in(item.path, (one,))))
    modules = list(dict.fromkeys(item.path for item in items))
    live = [path for path in modules if is_in(path, LIVE)]
    others = [path for path in modules if not is_in(path, LIVE)]
    place = {path: n / len(kind) for kind in (live, others) for n, path in enumerate(kind)}
    items.sort(key=lambda item: place[item.path])


def pytest_collection_finish():
    """Look for garbage in what tests make alone, and seldom: what was collected stays to the end.

    By default Python looks after each 700 new objects, which takes a tenth of a test's time.
    """
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000, 20, 100)


def pytest_sessionfinish(session, exitstatus):
    """Be content where a change concerns no slow test."""
    if exitstatus == pytest.ExitCode.NO_TESTS_COLLECTED and session.config.option.changed_since:
        session.exitstatus = pytest.ExitCode.OK


@pytest.fixture(scope="session", autouse=True)
def one_thread():
    """Calculate in one thread in this process, as the package does where it solves.

    Small matrices gain nothing by more, and the threads of tests in several processes wait for each
    other: that takes seven times the processor time.
    """
    with ThreadpoolController().limit(limits=1, user_api="blas"):
        yield


@pytest.fixture
def room():
    """Hold the room of a whole cell, for a test that has another process start one."""
    with room_for_a_cell():
        yield


@pytest.fixture(scope="module", autouse=True)
def domain_of_the_module(request):
    """Give a live module a ROS domain, in which is what its tests share, and quick processes."""
    if not is_in(request.path, LIVE):
        yield None
        return
    from ros_processes import nodes_ended

    with (
        own_domain() as number,
        nodes_ended(),
        mock.patch.object(subprocess, "Popen", ForkedPopen),
    ):
        yield number


@pytest.fixture(scope="session", autouse=True)
def ctrl_c():
    """Let Ctrl-C end what tests start, as in a terminal.

    A shell lets what it starts in the background ignore it, and all of its children too.
    """
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(autouse=True)
def process_as_before():
    """Handle signals and the command line as before, whatever a test did in this process.

    A command that becomes a node changes the command line, which the client library reads.
    """
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    given = list(sys.argv)
    yield
    sys.argv = given
    for number, handler in handlers.items():
        signal.signal(number, handler)


@pytest.fixture(scope="session")
def validators():
    """Return a validator for each schema, by its identifier."""
    return {
        schemas.identifier(name): jsonschema_rs.Draft202012Validator(schemas.schema(name))
        for name in schemas.VERSIONS
    }


@pytest.fixture(autouse=True)
def every_document_fits_its_schema(validators, monkeypatch):
    """Validate documents as they are written, wherever that is in this process."""
    written = schemas.json_text

    def checked(made):
        errors = validators[made["schema"]].iter_errors(made)
        faults = [f"{error.instance_path}: {error.message[:200]}" for error in errors]
        assert not faults, "\n".join(faults[:10])
        return written(made)

    monkeypatch.setattr(schemas, "json_text", checked)
