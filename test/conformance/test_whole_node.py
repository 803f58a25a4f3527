"""A node of the suite in a process of its own, with whatever rclpy there is: the whole of it."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from patience import PATIENCE
from ros_processes import spin_until

CASE = Path(__file__).parents[1] / "data/cases/four_diagonals"
NAME, SPACE = "solver", "/cell"


def command(*arguments: str) -> list[str]:
    namespace = ("-r", f"__ns:={SPACE}")
    program = [sys.executable, "-m", f"stepdiag_ros.nodes.{NAME}"]
    return [*program, "--ros-args", *namespace, *arguments]


@pytest.fixture
def solver(node: Any) -> Iterator[subprocess.Popen[str]]:
    """Return a solver that is up; the end of the test is the end of it, if it has none before."""
    with subprocess.Popen(command(), stderr=subprocess.PIPE, text=True) as process:
        assert spin_until(node, lambda: (NAME, SPACE) in node.get_node_names_and_namespaces())
        yield process
        process.kill()


def call(node: Any, kind: Any, name: str, request: Any) -> Any:
    client = node.create_client(kind, f"{SPACE}/{NAME}/{name}")
    assert spin_until(node, client.service_is_ready)
    future = client.call_async(request)
    assert spin_until(node, future.done)
    return future.result()


def test_it_says_what_it_is(node: Any, solver: subprocess.Popen[str]) -> None:
    from diagnostic_msgs.msg import DiagnosticArray
    from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
    from rcl_interfaces.srv import ListParameters, SetParameters

    from stepdiag_ros import topics

    outlets = node.get_publisher_names_and_types_by_node
    result = f"{SPACE}/{topics.VOLUMETRIC_ERRORS.name}"
    seen = (result, [topics.VOLUMETRIC_ERRORS.type_name])
    assert spin_until(node, lambda: seen in outlets(NAME, SPACE))
    (end,) = node.get_publishers_info_by_topic(result)
    assert (end.node_name, end.node_namespace, end.topic_type) == (
        NAME,
        SPACE,
        topics.VOLUMETRIC_ERRORS.type_name,
    )
    assert end.qos_profile.durability.name == "TRANSIENT_LOCAL"
    assert end.qos_profile.reliability.name == "RELIABLE"
    inlets = node.get_subscriber_names_and_types_by_node
    for topic in (topics.RUN_DESCRIPTION, topics.RUN_STATE, topics.LINE):
        seen = (f"{SPACE}/{topic.name}", [topic.type_name])
        assert spin_until(node, lambda seen=seen: seen in inlets(NAME, SPACE))  # type: ignore[misc]

    names = call(node, ListParameters, "list_parameters", ListParameters.Request()).result.names
    assert "use_sim_time" in names
    value = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value="demo")
    wrong = SetParameters.Request(parameters=[Parameter(name="plans", value=value)])
    refused = call(node, SetParameters, "set_parameters", wrong).results[0]
    assert not refused.successful and refused.reason

    heartbeat = f"{SPACE[1:]}/{NAME}: heartbeat"
    said: list[Any] = []
    node.create_subscription(
        DiagnosticArray, "/diagnostics", lambda array: said.extend(array.status), 10
    )
    assert spin_until(node, lambda: any(one.name == heartbeat for one in said))
    assert solver.poll() is None


def test_what_it_solves_is_what_its_method_gives(
    node: Any, solver: subprocess.Popen[str], tmp_path: Path
) -> None:
    """A run comes in as recorded; the results are the same bytes as computed in this process."""
    from rclpy.serialization import serialize_message
    from stepdiag_ros.msg import VolumetricErrors

    from stepdiag_ros import topics
    from stepdiag_ros.bags.reader import BagReader
    from stepdiag_ros.bags.run import load_run
    from stepdiag_ros.evaluation.solving import solve_reproducibly
    from stepdiag_ros.messages.volumetric import from_volumetric_errors
    from stepdiag_ros.nodes.links import message_class, quality

    bag = recorded(tmp_path)
    run = load_run(bag)
    got: dict[tuple[str, int], bytes] = {}
    outlets = {}
    for topic in (topics.RUN_DESCRIPTION, topics.LINE):
        name = f"{SPACE}/{topic.name}"
        outlets[topics.absolute(topic)] = node.create_publisher(
            message_class(topic), name, quality(topic)
        )

    def hear(result: Any) -> None:
        got[result.method, result.lines] = bytes(serialize_message(result))

    node.create_subscription(
        VolumetricErrors,
        f"{SPACE}/{topics.VOLUMETRIC_ERRORS.name}",
        hear,
        quality(topics.VOLUMETRIC_ERRORS),
    )
    assert spin_until(node, lambda: all(one.get_subscription_count() for one in outlets.values()))
    with BagReader(bag) as reader:
        for record in reader.records(topics=outlets):
            outlets[record.topic].publish(record.data)
            # A description that comes after its first line would be no run.
            spin_until(node, lambda: False, 0.2 if "description" in record.topic else 0.0)
    last = run.measurement.lines[-1].end_time
    solved, _ = solve_reproducibly(run.measurement)
    wanted = {
        (method, result.lines): bytes(
            serialize_message(from_volumetric_errors(result, run.run_id, last))
        )
        for method, result in solved.items()
    }
    assert spin_until(
        node, lambda: all(got.get(key) == value for key, value in wanted.items()), 60.0
    ), {key: got.get(key) == value for key, value in wanted.items()}
    assert solver.poll() is None


def recorded(folder: Path) -> Path:
    """Return a bag with the first pass of each line of a case."""
    (folder / "case.yaml").write_text((CASE / "case.yaml").read_text())
    head, *rows = (CASE / "run.csv").read_text().splitlines()
    table = folder / "run.csv"
    table.write_text("\n".join([head, *(row for row in rows if ",0,forward," in row)]) + "\n")
    bag = folder / "run.mcap"
    made = [sys.executable, "-m", "stepdiag_ros.cli", "import", str(table), str(bag)]
    subprocess.run(made, check=True, capture_output=True, timeout=PATIENCE)
    return bag


@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGTERM])
def test_it_ends_when_told(solver: subprocess.Popen[str], end: signal.Signals) -> None:
    solver.send_signal(end)
    _, said = solver.communicate(timeout=PATIENCE)
    assert solver.returncode == 0, said
    assert "Traceback" not in said


def test_it_refuses_what_it_does_not_know() -> None:
    for wrong, told in (("plans:=demo", "has no parameter 'plans'"), ("use_sim_time:=2", "2")):
        done = subprocess.run(
            command("-p", wrong), capture_output=True, text=True, timeout=PATIENCE
        )
        assert done.returncode == 1
        (line,) = [one for one in done.stderr.splitlines() if one.startswith("stepdiag: error: ")]
        assert told in line and "Traceback" not in done.stderr
