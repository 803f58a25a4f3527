"""What a node says of itself on /diagnostics: which word counts, when it is said, in which form."""

from types import SimpleNamespace

import pytest

import stepdiag_ros.client  # noqa: F401 - makes rclpy importable
from stepdiag_ros.run.health import HealthFinding, Level
from stepdiag_ros.run.supervision import (
    GETTING_READY,
    HEARTBEAT_PERIOD,
    START_PATIENCE,
    measure_together,
    peer_of,
)


class Log(list):
    def __getattr__(self, level):
        return lambda text: self.append((level, text))


class Speaker:
    """A node's health, with a stand-in for the node and its clock."""

    def __init__(self):
        from builtin_interfaces.msg import Time

        from stepdiag_ros.nodes.health import Health

        self.log, self.arrays, self.time = Log(), [], 100.0
        self.simulated, self.graph = False, [("recorder", "/cell")]
        self.namespace = "/cell"
        now = SimpleNamespace(to_msg=lambda: Time(sec=5))
        node = SimpleNamespace(
            get_logger=lambda: self.log,
            get_clock=lambda: SimpleNamespace(now=lambda: now),
            get_fully_qualified_name=lambda: "/cell/recorder",
            get_namespace=lambda: self.namespace,
            get_parameter=lambda _name: SimpleNamespace(value=self.simulated),
            get_node_names_and_namespaces=lambda: self.graph,
            context=SimpleNamespace(ok=lambda: True),
        )
        outlet = SimpleNamespace(publish=self.arrays.append)
        self.health = Health(node, "recorder", outlet, lambda: self.time, lambda: "run 1")
        self.finding = HealthFinding(Level.OK, "all well", {"number (m)": "7"})
        self.health.add_task("subject", lambda: self.finding)

    def heartbeat(self):
        self.health.beat()
        status = self.arrays[-1].status[0]
        return ord(status.level), status.message

    def told(self):
        """Return the names of the statuses in each array, and forget them."""
        names = [[status.name for status in array.status] for array in self.arrays]
        self.arrays.clear()
        return names


@pytest.fixture
def speaker():
    return Speaker()


HEARTBEAT, SUBJECT = "cell/recorder: heartbeat", "cell/recorder: subject"


def test_a_change_is_told_at_once_and_the_rest_once_a_second(speaker):
    speaker.health.look()
    assert speaker.told() == [[HEARTBEAT, SUBJECT]]
    for _ in range(int(1.0 / HEARTBEAT_PERIOD)):
        speaker.time += HEARTBEAT_PERIOD
        speaker.health.look()
        speaker.health.beat()
    assert speaker.told() == [[HEARTBEAT], [HEARTBEAT, SUBJECT]]
    speaker.finding = HealthFinding(Level.OK, "all well", {"number (m)": "8"})
    speaker.health.look()
    assert speaker.told() == [], "figures alone are no news"
    speaker.finding = HealthFinding(Level.WARN, "not so well")
    speaker.health.look()
    assert speaker.told() == [[HEARTBEAT, SUBJECT]]


def test_the_worst_word_counts_and_each_goes_as_it_came(speaker):
    health = speaker.health
    health.say(Level.OK, "run 1")
    assert speaker.heartbeat() == (0, "run 1")
    health.miss("the solver is silent")
    assert speaker.heartbeat() == (1, "the solver is silent")
    speaker.finding = HealthFinding(Level.STALE, "no reading", forbids=True)
    health.look()
    assert speaker.heartbeat() == (2, "no reading")
    health.unwell("the disk is full")
    assert speaker.heartbeat() == (2, "the disk is full")
    health.not_ready("not in use")
    assert speaker.heartbeat() == (2, "not in use")
    health.ready()
    assert speaker.heartbeat() == (2, "the disk is full")
    health.say(Level.OK, "run 2")
    assert speaker.heartbeat() == (2, "no reading")
    speaker.finding = HealthFinding(Level.STALE, "no reading")
    health.look()
    assert speaker.heartbeat() == (0, "run 2"), "what forbids nothing is told by its own status"
    health.miss("the solver is silent")
    health.miss_only(["the solver is silent", "the clock is silent"])
    assert speaker.heartbeat() == (1, "the solver is silent")
    health.miss_only([])
    assert speaker.heartbeat() == (0, "run 2")


def test_the_log_has_each_trouble_once_and_its_end(speaker):
    texts = [
        HealthFinding(Level.STALE, "not begun"),
        HealthFinding(Level.OK, "well"),
        HealthFinding(Level.WARN, "dim"),
        HealthFinding(Level.WARN, "dim", {"figure": "2"}),
        HealthFinding(Level.ERROR, "lost"),
        HealthFinding(Level.OK, "well"),
        HealthFinding(Level.STALE, "silent"),
    ]
    for speaker.finding in texts:
        speaker.health.look()
    assert speaker.log == [
        ("warning", "subject: dim"),
        ("error", "subject: lost"),
        ("info", "subject: well"),
        ("warning", "subject: silent"),
    ]


class TestStarting:
    """What is not ready counts as starting: for a while, before it was ready, and by itself."""

    NOT_BEGUN = HealthFinding(Level.STALE, "not begun")

    def starting(self, speaker):
        """Return the tasks that are said to be starting."""
        speaker.health.look()
        speaker.time += 1.0
        speaker.health.beat()
        return {
            status.name.rpartition(": ")[2]
            for status in speaker.arrays[-1].status
            if any(entry.key == GETTING_READY for entry in status.values)
        }

    def test_a_node_that_gets_ready_by_itself_and_what_waits_for_it(self, speaker):
        speaker.finding = self.NOT_BEGUN
        speaker.health.not_ready("waiting for the clock", by_itself=True)
        assert self.starting(speaker) == {"heartbeat", "subject"}
        speaker.health.ready()
        assert self.starting(speaker) == {"subject"}
        speaker.finding = HealthFinding(Level.OK, "well")
        assert self.starting(speaker) == set()
        speaker.finding = self.NOT_BEGUN
        assert self.starting(speaker) == set(), "it was well before"

    def test_a_start_that_lasts(self, speaker):
        speaker.finding = self.NOT_BEGUN
        speaker.health.not_ready("waiting for the clock", by_itself=True)
        speaker.time += START_PATIENCE
        assert self.starting(speaker) == set()
        # The subject could not begin before the node was ready.
        speaker.health.ready()
        assert self.starting(speaker) == {"subject"}
        speaker.time += START_PATIENCE
        assert self.starting(speaker) == set()

    def test_what_waits_for_somebody_or_stops_a_run(self, speaker):
        speaker.finding = self.NOT_BEGUN
        speaker.health.not_ready("unconfigured: configure the node")
        assert self.starting(speaker) == set()
        speaker.health.ready()
        speaker.finding = HealthFinding(Level.STALE, "silent", forbids=True)
        assert self.starting(speaker) == set()
        speaker.finding = HealthFinding(Level.ERROR, "broken")
        assert self.starting(speaker) == set()


def test_others_know_the_node_by_its_heartbeat(speaker):
    other = Speaker()
    other.health.hardware_id = "serial 17"
    other.health.facts["stored"] = "run 1 5"
    other.health.live_facts.update(heard=lambda: "9", nothing=lambda: "")
    other.health.unwell("the disk is full")
    ((name, peer),) = speaker.health.peers_in(other.arrays[-1])
    assert name == "/cell/recorder"
    assert (peer.role, peer.run_id, peer.text, peer.faulty) == (
        "recorder",
        "run 1",
        "the disk is full",
        True,
    )
    assert peer.facts["stored"] == "run 1 5" and peer.facts["heard"] == "9"
    assert "nothing" not in peer.facts
    assert other.arrays[-1].status[0].hardware_id == "serial 17"
    assert other.health.peers_in(other.arrays[-1]) == [], "nobody is a peer of itself"


@pytest.mark.parametrize("namespace", ["/", "/cell_2", "/cell/inner", "/cel"])
def test_nodes_of_another_cell_are_no_peers(speaker, namespace):
    other = Speaker()
    other.health.beat()
    speaker.namespace = namespace
    assert speaker.health.peers_in(other.arrays[-1]) == []


@pytest.mark.parametrize("name", ["/clock", "/simulation/clock"])
def test_one_clock_may_be_there_for_all_cells(name):
    values = {"role": "clock", "session": "1"}
    named = peer_of(f"{name[1:]}: heartbeat", 0, "", values, 0.0)
    assert named is not None and measure_together("/cell", True, *named)
    # A machine's time is real: simulated time of others is nothing to it.
    assert not measure_together("/cell", False, *named)
    lent = peer_of("recorder: heartbeat", 0, "", {**values, "role": "recorder"}, 0.0)
    assert lent is not None and measure_together("/", True, *lent)
    assert not measure_together("/cell", True, *lent)


def test_heartbeats_in_a_recording_are_of_nobody(speaker):
    other = Speaker()
    other.health.beat()
    assert len(speaker.health.peers_in(other.arrays[-1])) == 1, "a node of the same name"
    speaker.simulated = True
    assert speaker.health.peers_in(other.arrays[-1]) == [], "only this one is in the graph"
    speaker.graph = [("recorder", "/cell"), ("solver", "/"), ("recorder", "/cell")]
    assert len(speaker.health.peers_in(other.arrays[-1])) == 1
    speaker.graph = []
    assert len(speaker.health.peers_in(other.arrays[-1])) == 1, "it was seen once"


def test_other_statuses_are_no_heartbeats(speaker):
    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

    foreign = DiagnosticStatus(name="motor: heartbeat", values=[KeyValue(key="role", value="x")])
    subject = DiagnosticStatus(name="recorder: subject")
    assert speaker.health.peers_in(DiagnosticArray(status=[foreign, subject])) == []
