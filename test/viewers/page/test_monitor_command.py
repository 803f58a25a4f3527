"""``stepdiag monitor``, the launch file, a bag played into the page, and who leads a run."""

import sys
import threading
from pathlib import Path
from types import SimpleNamespace

import fake_launch
import pytest
from refused import refused

import stepdiag_ros.client  # noqa: F401 - makes rclpy importable
from stepdiag_ros.bags.errors import BagError
from stepdiag_ros.bags.run import load_run
from stepdiag_ros.cli import main
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.nodes.operator import SERVICE_LIMIT
from stepdiag_ros.viewers.page.control import RequestAnswer
from stepdiag_ros.viewers.page.replay import Replay
from stepdiag_ros.viewers.page.state import PageState

ROOT = Path(__file__).parents[3]
BAG = ROOT / "test" / "data" / "bags" / "schema_1.mcap"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--rate", "2"], "--rate is for a bag, and none is given"),
        (["--run", "a"], "--run is for a bag, and none is given"),
        (["none.mcap", "--port", "0"], "there is no bag none.mcap"),
        ([str(BAG), "--address", "0.0.0.0"], "other computers can reach the address '0.0.0.0'"),
        ([str(BAG), "--run", "a", "--port", "0"], "holds no run 'a'"),
    ],
)
def test_what_cannot_be_shown_is_refused_in_one_sentence(arguments, said, capsys):
    assert main(["monitor", *arguments]) == 1
    error = capsys.readouterr().err
    assert error.startswith("stepdiag: error: ") and said in error and error.count("\n") == 1


@pytest.mark.parametrize("port", ["70000", "-1", "http"])
def test_a_port_is_a_number(port, capsys):
    with refused(SystemExit, code=2):
        main(["monitor", str(BAG), "--port", port])
    assert "is not a port. Use a number from 0 to 65535" in capsys.readouterr().err


def test_a_bag_is_folded_in_as_it_was_recorded():
    run, state = load_run(BAG), PageState()
    replay = Replay(BAG, state)
    assert replay.play(0.0, threading.Event()) > 5
    replay.close()
    told = state.document("run")
    assert told["run_id"] == run.run_id and told["plan"] == run.plan.name
    assert state.document("curves")["lines"] == run.results[-1].lines
    assert state.document("verdict")["sentence"] == run.diagnoses[-1].sentence
    assert state.document("stop")["last"]["stop"] == run.stops[-1].command.stop
    assert state.document("blocks")["last"]["displacement_m"] == run.blocks[-1].displacement


def test_a_replay_ends_when_it_is_told_to():
    state, stop = PageState(), threading.Event()
    stop.set()
    replay = Replay(BAG, state)
    assert replay.play(1.0, stop) == 0
    replay.close()
    # Which run it is is known at once.
    assert state.document("run")["plan"] == load_run(BAG).plan.name


def test_what_is_no_bag_is_refused(tmp_path):
    path = tmp_path / "text.mcap"
    path.write_text("no bag")
    with refused(BagError, "wrong_kind", "text.mcap"):
        Replay(path, PageState())


def test_the_page_is_launched_where_it_is_asked_for(monkeypatch):
    for name, module in fake_launch.modules().items():
        monkeypatch.setitem(sys.modules, name, module)
    sys.modules.pop("stepdiag_ros.processes.launching", None)
    file = ROOT / "launch" / "monitor.launch.py"
    try:
        _, actions = fake_launch.launched(file, page="true", page_port="0", use_sim_time="true")
        assert [one.options["executable"] for one in actions] == ["scene", "monitor"]
        with refused(Refusal, "malformed", "x", "page_port"):
            fake_launch.launched(file, page="true", page_port="x")
    finally:
        sys.modules.pop("stepdiag_ros.processes.launching", None)


class Client:
    """A client of a service that answers when it is told to."""

    def __init__(self, name):
        self.name, self.ready, self.asked, self.dropped = name, False, 0, 0
        self.response = None

    def service_is_ready(self):
        return self.ready

    def call_async(self, _request):
        self.asked += 1
        return self

    def done(self):
        return self.response is not None

    def result(self):
        return self.response

    def remove_pending_request(self, _future):
        self.dropped += 1


class Node:
    """As much of a node as control needs."""

    def __init__(self):
        self.clients, self.time = {}, 0.0

    def create_client(self, _kind, name):
        self.clients[name] = Client(name)
        return self.clients[name]

    def real_time(self):
        return self.time


@pytest.fixture
def led():
    from stepdiag_ros.nodes.run_control import RunControl

    node = Node()
    return node, RunControl(node)


def test_control_goes_to_whoever_leads_the_run(led):
    node, control = led
    assert sorted(node.clients) == [
        *(f"by_hand/{action}" for action in ("abort", "resume", "start")),
        *(f"sequencer/{action}" for action in ("abort", "pause", "resume", "start")),
    ]
    node.clients["by_hand/start"].ready = True
    answer = control.ask("start")
    assert not answer.done()
    control.work()
    assert node.clients["by_hand/start"].asked == 1 and not answer.done()
    node.clients["by_hand/start"].response = SimpleNamespace(success=False, message="no recorder")
    control.work()
    assert answer.result(0) == RequestAnswer(False, "no recorder")
    control.work()
    assert node.clients["by_hand/start"].asked == 1


def test_nobody_there_and_nobody_who_answers_are_said(led):
    node, control = led
    answer = control.ask("pause")
    control.work()
    assert answer.result(0).text == "there is no sequencer node that could pause a run"
    node.clients["sequencer/abort"].ready = True
    answer = control.ask("abort")
    control.work()
    node.time = SERVICE_LIMIT + 1.0
    control.work()
    assert not answer.result(0).done
    assert "whether abort was done is not known" in answer.result(0).text
    assert node.clients["sequencer/abort"].dropped == 1
