"""What ``ros2 param set`` changes takes effect, and the record has it."""

import time
from importlib import import_module
from itertools import pairwise
from types import SimpleNamespace

import pytest
import rclpy
from patience import PATIENCE
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter

from stepdiag_ros.messages.fields import to_nanoseconds
from stepdiag_ros.nodes.managed import Stream
from stepdiag_ros.nodes.parameters import CONFIRMED, GHOST, ParameterCollector
from stepdiag_ros.parameters.declaration import Changeable
from stepdiag_ros.parameters.nodes import declared_node
from stepdiag_ros.run.supervision import WORK_LEFT


def refusal(node, name, value):
    """Set a parameter as its service does; return why not, or an empty text."""
    result = node.set_parameters_atomically([Parameter(name, value=value)])
    assert result.successful is not bool(result.reason)
    return result.reason


def test_the_diagnosis_takes_another_model_once_nothing_is_left_to_diagnose():
    from stepdiag_ros.nodes.diagnosis import DiagnosisNode

    rclpy.init(args=[])
    node = DiagnosisNode()
    try:
        free = node._model
        assert "there is no model 'nonsense'" in refusal(node, "model", "nonsense")
        assert refusal(node, "model", "demo") == ""
        demo = node._model
        assert (demo.name, node.parameter("model")) != (free.name, "free")
        node.run_id, node.run_over, node.facts[WORK_LEFT] = "a-run", True, "1"
        for name, value in (("model", "free"), ("seed", 3)):
            assert (
                refusal(node, name, value) == "run a-run is still being diagnosed: wait for its end"
            )
        assert node._model is demo and node.parameter("seed") == 0
        node.facts[WORK_LEFT] = "0"
        assert refusal(node, "seed", 3) == "" == refusal(node, "model", "free")
        assert node._model.name == free.name
        node.run_over = False
        assert refusal(node, "pause_s", 0.25) == ""
        assert node._pause == 0.25
    finally:
        node.close()
        node.destroy_node()
        rclpy.try_shutdown()


def test_the_recorder_writes_into_another_folder_and_knows_all_parameters(tmp_path):
    from stepdiag_ros.nodes.clock import ClockNode
    from stepdiag_ros.nodes.recorder import RecorderNode

    first, second, file = tmp_path / "first", tmp_path / "second", tmp_path / "file"
    file.touch()
    rclpy.init(args=["", "--ros-args", "-p", f"recorder:folder:={first}"])
    recorder, clock = RecorderNode(), ClockNode()
    executor = SingleThreadedExecutor()
    for node in (recorder, clock):
        executor.add_node(node)
    known = recorder._collector.values

    def wait_for(condition):
        end = time.monotonic() + PATIENCE
        while not condition():
            if time.monotonic() > end:
                return False
            executor.spin_once(timeout_sec=0.01)
        return True

    try:
        assert first.is_dir()
        assert wait_for(lambda: {"/recorder", "/clock"} <= set(known)), known
        assert known["/clock"]["factor"] == 1.0
        assert known["/recorder"]["folder"] == str(first)
        assert refusal(recorder, "folder", str(file)) == f"{file}: file exists"
        assert refusal(recorder, "folder", str(file / "x")) == f"{file / 'x'}: not a directory"
        assert recorder.parameter("folder") == str(first)
        assert refusal(recorder, "folder", str(second)) == "" == refusal(clock, "factor", 20.0)
        assert recorder._free_path("run") == second / "run.mcap" and second.is_dir()
        assert wait_for(lambda: known["/clock"]["factor"] == 20.0), known
        assert wait_for(lambda: known["/recorder"]["folder"] == str(second)), known
        # A clock that was started anew may have been given other parameters.
        recorder._collector.ask("/clock", "another process", recorder.real_time())
        assert "/clock" not in known
        assert wait_for(lambda: "/clock" in known) and known["/clock"]["factor"] == 20.0
    finally:
        recorder.close()
        for node in (recorder, clock):
            node.destroy_node()
        rclpy.try_shutdown()


@pytest.mark.parametrize(
    ("module", "kind", "name", "slow", "fast"),
    [
        ("interferometer", "InterferometerNode", "rate", 50.0, 500.0),
        ("weather", "WeatherNode", "rate", 20.0, 200.0),
        ("bridge", "BridgeNode", "position_rate", 20.0, 200.0),
    ],
)
def test_the_settings_of_a_device_are_taken_when_it_is_opened_again(
    monkeypatch, module, kind, name, slow, fast
):
    """The simulated devices stamp what they say on a grid of the rate that was asked for."""
    stamps = []
    rclpy.init(args=["", "--ros-args", "-p", "autostart:=false", "-p", f"{name}:={slow}"])
    node = getattr(import_module(f"stepdiag_ros.nodes.{module}"), kind)()

    def keep(_stream, message):
        stamps.append(to_nanoseconds(message.header.stamp))

    def keep_all(stream, messages):
        for message in messages:
            keep(stream, message)

    monkeypatch.setattr(Stream, "publish", keep)
    monkeypatch.setattr(Stream, "publish_all", keep_all)

    def spacing():
        """Return the least time between two of what the device has just said, s."""
        node.trigger_configure()
        node.trigger_activate()
        stamps.clear()
        if module == "interferometer":
            now = node.now()
            node.device.align(now, "a", "x", (0.1, 0.1, 0.1), (0.0, 0.0, 0.0))
        for _ in range(3):
            time.sleep(0.06)
            if module == "interferometer":
                node.device.update_position(node.now(), (0.0, 0.0, 0.0))
            node.look_at_device()
        return min(b - a for a, b in pairwise(sorted(set(stamps)))) * 1e-9

    try:
        assert spacing() == pytest.approx(1.0 / slow)
        assert refusal(node, name, fast) == (
            f"parameter '{name}' of node {node.get_name()} is set while the device is closed only:"
            f" close it first, with ros2 lifecycle set /{node.get_name()} deactivate, then cleanup"
        )
        node.trigger_deactivate()
        assert "while the device is closed only" in refusal(node, name, fast)
        node.trigger_cleanup()
        assert refusal(node, name, fast) == ""
        assert spacing() == pytest.approx(1.0 / fast)
        node.trigger_deactivate()
        node.trigger_cleanup()
        node.run_id, node.run_over = "a-run", False
        assert "run a-run is going on" in refusal(node, name, slow)
        if module == "interferometer":
            node.run_over = True
            # In range, and yet not what this instrument can do.
            assert "'rate_hz' is 0.001; expected" in refusal(node, "rate", 0.001)
            assert node.parameter("rate") == fast
    finally:
        node.close()
        node.destroy_node()
        rclpy.try_shutdown()


@pytest.mark.parametrize("role", ["interferometer", "weather", "cnc_bridge"])
def test_every_setting_that_is_taken_at_the_opening_is_asked_for_then(role, monkeypatch):
    rclpy.init(args=[])
    declared = declared_node(role)
    module = import_module(f"stepdiag_ros.nodes.{declared.module}")
    node = getattr(module, f"{declared.module.capitalize()}Node")()
    asked, parameter = set(), node.parameter
    monkeypatch.setattr(node, "parameter", lambda name: asked.add(name) or parameter(name))
    try:
        device = node.open_device()
        node.on_open(device)
        device.close()
    finally:
        node.close()
        node.destroy_node()
        rclpy.try_shutdown()
    taken = {one.name for one in declared.parameters if one.change is Changeable.WHILE_CLOSED}
    assert taken and taken <= asked


class Letters:
    """A node whose questions are answered when the test wants."""

    def __init__(self):
        self.open = []
        self.destroyed = 0

    def create_subscription(self, *_arguments):
        pass

    def destroy_client(self, _client):
        self.destroyed += 1

    def create_client(self, *_arguments):
        return SimpleNamespace(service_is_ready=lambda: True, call_async=self.ask)

    def ask(self, _request):
        return SimpleNamespace(add_done_callback=self.open.append)

    def answer(self, **fields):
        self.open.pop(0)(SimpleNamespace(result=lambda: SimpleNamespace(**fields)))


def test_an_answer_that_is_older_than_a_change_or_than_the_process_does_not_count():
    letters = Letters()
    collector = ParameterCollector(letters)
    old, new = (Parameter("factor", value=value).to_parameter_msg() for value in (1.0, 2.0))
    names = SimpleNamespace(names=["factor"])

    collector.ask("/clock", "first", 0.0)
    letters.answer(result=names)
    collector._on_event(SimpleNamespace(node="/clock", changed_parameters=[new]))
    letters.answer(values=[old.value])
    assert collector.values == {"/clock": {"factor": 2.0}}

    collector.ask("/clock", "second", 1.0)
    assert collector.values == {} and collector.waiting(1.5)
    letters.answer(result=names)
    collector.ask("/clock", "third", 1.1)
    letters.answer(values=[new.value])
    assert collector.values == {}, "the answer is of a process that is gone"
    letters.answer(result=names)
    letters.answer(values=[old.value])
    assert collector.values == {"/clock": {"factor": 1.0}} and not collector.waiting(1.5)


def test_no_client_is_destroyed_while_a_killed_process_may_owe_it_a_confirmation():
    letters = Letters()
    collector = ParameterCollector(letters)

    def answered():
        letters.answer(result=SimpleNamespace(names=[]))
        letters.answer(values=[])

    collector.ask("/clock", "first", 0.0)
    answered()
    collector.ask("/clock", "first", 0.9 * CONFIRMED)
    assert letters.destroyed == 0, "it was asked a moment ago"
    collector.ask("/clock", "first", CONFIRMED)
    assert letters.destroyed == 2, "nobody was killed"

    collector.ask("/clock", "second", 10.0)
    answered()
    collector.ask("/clock", "second", 10.0 + GHOST / 2)
    assert letters.destroyed == 2, "the first process was killed a moment ago"
    collector.ask("/clock", "second", 10.0 + GHOST)
    assert letters.destroyed == 4

    collector.ask("/clock", "third", 50.0)
    collector.ask("/clock", "fourth", 50.5)
    assert letters.destroyed == 4, (
        "the third never answered, and the fourth is asked by its clients"
    )
