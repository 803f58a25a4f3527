"""A cell whose data a test meddles with: /diagnostics says it in words, and the run heeds it."""

import itertools
import statistics
import time
from pathlib import Path

import pytest
import rclpy
import yaml
from drivers_for_tests import bring_drivers
from meddled_devices import meddling
from patience import PATIENCE
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from refused import refused

from stepdiag_ros import topics
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.nodes.assembler import AssemblerNode
from stepdiag_ros.nodes.bridge import BridgeNode
from stepdiag_ros.nodes.interferometer import InterferometerNode
from stepdiag_ros.nodes.links import message_class, quality
from stepdiag_ros.nodes.recorder import RecorderNode
from stepdiag_ros.nodes.sequencer import SequencerNode
from stepdiag_ros.nodes.solver import SolverNode
from stepdiag_ros.nodes.weather import WeatherNode
from stepdiag_ros.parameters.nodes import NODES
from stepdiag_ros.run.health import Level
from stepdiag_ros.run.sequence import State

CONFIG = Path(__file__).parents[2] / "config"
KINDS = (
    RecorderNode,
    SolverNode,
    AssemblerNode,
    WeatherNode,
    BridgeNode,
    InterferometerNode,
    SequencerNode,
)
TIMEOUT = 2.0
"""Real seconds after which the devices' data are stale here; receivers wait a little longer."""
STALE = f"has come for more than {TIMEOUT:g} s"


@pytest.fixture
def cell(monkeypatch, tmp_path):
    meddling.clear()
    bring_drivers(
        monkeypatch,
        ("cnc", "meddled", "meddled_devices:cnc"),
        ("interferometer", "meddled", "meddled_devices:laser"),
    )
    for kind in (InterferometerNode, BridgeNode):
        monkeypatch.setattr(kind, "poll_period", 0.01)
    made = Cell(tmp_path)
    yield made
    made.end()


class Cell:
    """All nodes of a measurement in one process and one namespace, and what they say."""

    def __init__(self, folder):
        laser = {"device": "meddled", "rate": 100.0, "reading_timeout": TIMEOUT, "hold_after": 0.1}
        machine = {"device": "meddled", "position_timeout": TIMEOUT, "hardware_id": "mill 7"}
        # All nodes share a thread: on a busy computer they are slow together, which is no fault
        # here, and the machine is none that could hit anything.
        machine["silence_limit"] = 10.0
        given = {
            # The weather is that of a simulated cell.
            "sequencer": {"plan": "quick", "cell": "demo"},
            "recorder": {"folder": str(folder)},
            "cnc_bridge": machine,
            "interferometer": laser,
            "weather": {"rate": 5.0},
        }
        file = folder / "parameters.yaml"
        nodes = {f"/cell/{name}": {"ros__parameters": values} for name, values in given.items()}
        nodes["/**"] = {"ros__parameters": {"heartbeat_timeout": 60.0}}
        file.write_text(yaml.safe_dump(nodes))
        rclpy.init(args=["--ros-args", "-r", "__ns:=/cell", "--params-file", str(file)])
        self.nodes = {kind.role: kind() for kind in KINDS}
        self.listener = rclpy.create_node("listener")
        self.executor = SingleThreadedExecutor()
        for node in (*self.nodes.values(), self.listener):
            self.executor.add_node(node)
        self.said, self.times, self.arrays = {}, {}, []
        # Names and statuses in the order in which they were heard.
        self.heard = []
        self.listener.create_subscription(
            message_class(topics.DIAGNOSTICS),
            "/diagnostics",
            self.hear,
            quality(topics.DIAGNOSTICS),
        )
        self.sequencer = self.nodes["sequencer"]

    def hear(self, array):
        self.arrays.append(array)
        for status in array.status:
            assert status.name not in [s.name for s in array.status if s is not status]
            self.heard.append((status.name.removeprefix("cell/"), status))
            self.said[status.name.removeprefix("cell/")] = status
            self.times.setdefault(status.name, []).append(time.monotonic())

    def until(self, condition, what, limit=PATIENCE):
        deadline = time.monotonic() + limit
        while not condition():
            if time.monotonic() > deadline:
                told = {name: (ord(s.level), s.message) for name, s in self.said.items()}
                raise AssertionError(f"not in {limit} s: {what}; {told}")
            self.executor.spin_once(0.02)

    def hears(self, name, level, words="", since=None):
        """Wait until a status is told at a level, with these words in its message.

        Args:
            name: of the status.
            level: of it.
            words: in it.
            since: number of statuses heard before, for one that may have passed again; None for one
                that holds now.
        """
        found = []

        def told():
            now = [(name, self.said[name])] if name in self.said else []
            found[:] = (
                status
                for its, status in (now if since is None else self.heard[since:])
                if its == name and ord(status.level) == level and words in status.message
            )
            return bool(found)

        self.until(told, f"{name}: {level!r} '{words}'")
        return {entry.key: entry.value for entry in found[-1].values}

    def tells(self, name, key, words):
        """Wait until a value of a status has these words in it."""

        def told():
            values = self.said[name].values if name in self.said else []
            return any(entry.key == key and words in entry.value for entry in values)

        self.until(told, f"{name}: {key}: '{words}'")

    def state(self):
        sequence = self.sequencer._sequence
        return sequence.state if sequence else None

    def await_state(self, state):
        self.until(lambda: self.state() is state, state)

    def ask(self, action):
        """Ask the sequencer until it does it, and return its answer."""
        answers = []

        def asked():
            try:
                answers.append(action())
            except ValueError:
                return False
            return True

        self.until(asked, action.__name__)
        return answers[0]

    def end(self):
        for node in self.nodes.values():
            node.close()
            node.destroy_node()
        self.listener.destroy_node()
        rclpy.shutdown()


def test_what_goes_wrong_is_told_in_words_stops_the_run_and_passes(cell):
    cell.hears("interferometer: heartbeat", Level.OK)
    cell.hears("cnc_bridge: axes", Level.OK, "ready")
    cell.hears("weather: sensors", Level.OK, "known")
    cell.hears("interferometer: beam", Level.OK, "there is no beam")
    cell.ask(cell.sequencer.start)
    cell.await_state(State.RUNNING)
    cell.hears("interferometer: beam", Level.OK, "the beam is there")
    values = cell.hears("interferometer: rate", Level.OK)
    assert 90.0 <= float(values["readings a second (Hz)"]) <= 110.0
    values = cell.hears("interferometer: weather", Level.OK)
    assert 0.0 <= float(values["age of the air pressure (s)"]) < 60.0
    assert cell.said["cnc_bridge: axes"].hardware_id == "mill 7"
    assert cell.said["interferometer: beam"].hardware_id == "meddled interferometer"

    # A weak signal does not stop the run.
    meddling.add("dim")
    cell.hears("interferometer: beam", Level.WARN, "the beam is dim")
    cell.tells("interferometer: beam", "lowest signal of the last second (0..1)", "0.05")
    # ... and what is weak is for the operator to say, at any time.
    node = cell.nodes["interferometer"]
    assert node.set_parameters([Parameter("dim_signal", value=0.01)])[0].successful
    cell.hears("interferometer: beam", Level.OK)
    meddling.clear()

    # A reading that the instrument itself has lost is missed by all who take them.
    before = len(cell.heard)
    meddling.add("skip")
    for node in ("interferometer", "assembler", "recorder"):
        # It is told for two seconds: on a busy computer it has passed before the next is heard.
        values = cell.hears(f"{node}: sequence", Level.WARN, "is missing", before)
        assert values["missing"] == "1" and values["first missing"] == values["last missing"]
    assert cell.state() is State.RUNNING

    # Readings that stop, stop the run; everyone sees why; it goes on once they are back.
    meddling.add("mute")
    cell.hears("interferometer: beam", Level.STALE, f"no reading {STALE}")
    cell.hears("interferometer: heartbeat", Level.ERROR, "no reading has come")
    cell.await_state(State.FAULT)
    cell.hears("sequencer: run", Level.ERROR, "interferometer: no reading has come")
    cell.hears("sequencer: heartbeat", Level.ERROR, "interferometer: no reading has come")
    with refused(Refusal, "not_ready", "resume", "interferometer"):
        cell.sequencer.resume()
    meddling.clear()
    cell.hears("interferometer: heartbeat", Level.OK)
    cell.ask(cell.sequencer.resume)
    cell.await_state(State.RUNNING)
    cell.hears("sequencer: run", Level.OK)

    # Positions that stop do the same.
    meddling.add("hold")
    cell.hears("cnc_bridge: axes", Level.STALE, f"no actual position {STALE}")
    cell.await_state(State.FAULT)
    cell.hears("sequencer: run", Level.ERROR, "cnc_bridge: no actual position")
    meddling.clear()
    cell.hears("cnc_bridge: heartbeat", Level.OK)
    cell.ask(cell.sequencer.resume)
    cell.await_state(State.RUNNING)
    cell.hears("interferometer: beam", Level.OK)

    # A lost beam costs the line, not the run; the next setup has a zero of its own.
    cell.until(lambda: cell.sequencer._progress().stop >= 1, "a stop has settled")
    before = len(cell.heard)
    meddling.add("lose")
    cell.hears("interferometer: beam", Level.ERROR, "the beam is lost")
    meddling.clear()
    # Until the next setup, which may be soon.
    cell.hears("interferometer: beam", Level.WARN, "the beam was lost for a moment", before)
    cell.tells("assembler: stops", "last rejection", "the zero is lost: the beam was lost")
    cell.until(lambda: is_measured_again(cell), "the line is measured again")
    cell.hears("interferometer: beam", Level.OK, "the beam is there")

    cell.hears("recorder: recording", Level.OK, "records a run")
    cell.sequencer.abort()
    cell.hears("sequencer: run", Level.OK, "aborted")
    cell.hears("interferometer: sequence", Level.OK, "before: ")

    the_form_is_that_of_diagnostic_updater(cell)
    every_status_has_one_analyzer(cell)
    every_status_is_documented(cell)


def is_measured_again(cell):
    """Say so; where the beam was away for all attempts at the line, an operator goes on first."""
    if cell.state() is State.FAULT:
        cell.ask(cell.sequencer.resume)
    status = cell.said["interferometer: beam"]
    return ord(status.level) == Level.OK and cell.state() is State.RUNNING


def the_form_is_that_of_diagnostic_updater(cell):
    for array in cell.arrays:
        assert array.header.stamp.sec > 0
        for status in array.status:
            node, _, task = status.name.partition(": ")
            assert node.startswith("cell/") and task and status.message and status.hardware_id
            assert all(
                entry.key and entry.value for entry in status.values if entry.key != "run_id"
            )
    for name, times in cell.times.items():
        gaps = [after - before for before, after in itertools.pairwise(times)]
        # A computer that does something else may leave one gap, but not most of them.
        assert statistics.median(gaps) < 2.5, f"{name} is reported about once a second"


def every_status_has_one_analyzer(cell):
    """Match as diagnostic_aggregator's GenericAnalyzer does: by any of the texts it contains."""
    config = yaml.safe_load((CONFIG / "diagnostics_aggregator.yaml").read_text())
    top = config["analyzers"]["ros__parameters"]
    (group,) = (entry for entry in top.values() if isinstance(entry, dict))
    analyzers = group["analyzers"]
    names = {status.name for array in cell.arrays for status in array.status}
    names |= {f"{node.name}: heartbeat" for node in NODES}
    names |= {f"stepdiag_{tool}: heartbeat" for tool in ("operator_17", "player")}
    for name in names:
        hits = [key for key, one in analyzers.items() if any(t in name for t in one["contains"])]
        assert len(hits) == 1, f"{name}: {hits}"
    for key, one in analyzers.items():
        assert any(t in name for name in names for t in one["contains"]), f"{key} has nothing"


def every_status_is_documented(cell):
    page = (CONFIG.parent / "docs" / "diagnostics.md").read_text()
    for name in cell.said:
        task = name.partition(": ")[2]
        assert f"`{name}`" in page or f"| `{task}` |" in page, name
