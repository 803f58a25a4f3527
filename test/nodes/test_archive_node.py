"""The node of an archive: it adds what a recorder has closed, and reports the machine's history."""

import archive_runs
import pytest
import rclpy
from patience import PATIENCE
from rclpy.executors import SingleThreadedExecutor
from refused import refused

from stepdiag_ros import topics
from stepdiag_ros.archive import catalogue
from stepdiag_ros.archive.place import Place
from stepdiag_ros.archive.work import bags_of
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.nodes.archive import ARCHIVED, ArchiveNode
from stepdiag_ros.nodes.links import message_class, quality
from stepdiag_ros.run.conclusion import BAG, BAG_CLOSED
from stepdiag_ros.run.supervision import Peer, fact_of_run

RUN = "20260102T030405Z-abcdef"


class Bench:
    """The node in this process, and what it says on /diagnostics."""

    def __init__(self, place, **parameters):
        given = {"place": place, **parameters}
        words = [word for name, value in given.items() for word in ("-p", f"{name}:={value}")]
        rclpy.init(args=["--ros-args", *words])
        self.node = ArchiveNode()
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.listener = rclpy.create_node("listener")
        self.executor.add_node(self.listener)
        self.said = {}
        self.listener.create_subscription(
            message_class(topics.DIAGNOSTICS),
            "/diagnostics",
            self._hear,
            quality(topics.DIAGNOSTICS),
        )

    def _hear(self, array):
        for status in array.status:
            name, _, task = status.name.partition(": ")
            if name == "archive":
                values = {entry.key: entry.value for entry in status.values}
                self.said[task] = (ord(status.level), status.message, values)

    def closes(self, bag, run_id=RUN):
        """Let a recorder say that it has closed a bag."""
        facts = {BAG: fact_of_run(run_id, str(bag)), BAG_CLOSED: fact_of_run(run_id, "10")}
        self.node.on_heartbeat(Peer("recorder", 0.0, "one", run_id, facts=facts))

    def until(self, condition):
        end = self.node.real_time() + PATIENCE
        while not condition():
            assert self.node.real_time() < end, self.said
            self.executor.spin_once(0.05)

    def level(self, task):
        return self.said.get(task, (None, "", {}))[0]


@pytest.fixture
def bench():
    made = []

    def make(place, **parameters):
        made.append(Bench(str(place), **parameters))
        return made[-1]

    yield make
    for one in made:
        one.node.close()
    rclpy.try_shutdown()


def test_a_closed_bag_is_added_once_and_what_cannot_be_is_said(bench, tmp_path):
    place = tmp_path / "archive"
    bag = archive_runs.write_bag(tmp_path / "run.mcap", streams=True)
    cell = bench(place)
    cell.until(lambda: cell.level("archive") == 0)
    cell.closes(tmp_path / "elsewhere.mcap", "another")
    cell.until(lambda: cell.level("archive") == 2)
    assert str(tmp_path / "elsewhere.mcap") in cell.said["archive"][1]
    for _ in range(3):
        cell.closes(bag)
    cell.until(lambda: cell.said["heartbeat"][2].get(ARCHIVED) == fact_of_run(RUN, str(place)))
    cell.until(lambda: cell.level("archive") == 0)
    assert [name.rpartition("/")[2] for name in bags_of(Place(str(place))).values()] == ["run.mcap"]
    # One run shows no trend, and that is no fault.
    cell.until(lambda: "demo machine" in cell.said["history"][1])
    assert cell.level("history") == 0 and cell.level("heartbeat") == 0


def test_the_history_of_a_machine_calls_for_attention_from_the_start(bench, tmp_path):
    place = Place(str(tmp_path / "archive"))
    growing_machine(place)
    cell = bench(place.url, machine="mill")
    cell.until(lambda: cell.level("history") == 1)
    _, text, values = cell.said["history"]
    assert "mill" in text and "C0Y" in text
    assert values["history"].startswith("mill: 12 runs")
    assert cell.level("heartbeat") == 0, "it is no fault of the measurement"


def growing_machine(place):
    """Fill an archive with runs of a machine whose squareness grows far beyond its uncertainty."""
    from datetime import timedelta

    for number in range(12):
        sha256 = archive_runs.digest(number)
        part = catalogue.part_of_bag(sha256)
        rows = archive_runs.made_up(
            sha256,
            part,
            machine="mill",
            start_time=archive_runs.BEGAN + timedelta(days=30 * number),
        )
        figures = [
            type(one)(**{**vars(one), "value": 1e-6 * number if one.name == "C0Y" else 0.0})
            for one in rows.figures
        ]
        catalogue.write_part(place, part, type(rows)(rows.runs, figures, rows.curves))


def test_a_node_without_an_archive_does_not_start(bench):
    with refused(Refusal, "missing", about="place"):
        bench("''")
    rclpy.try_shutdown()
