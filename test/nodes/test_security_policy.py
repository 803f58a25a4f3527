"""The security policy grants what the nodes really do, no less and no more."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable
from fnmatch import fnmatchcase
from importlib import import_module
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from patience import PATIENCE

import stepdiag_ros.client  # noqa: F401 - makes rclpy importable
from stepdiag_ros.commands.node import NODES
from stepdiag_ros.nodes.base import StepdiagNode
from stepdiag_ros.nodes.foxglove_server import STREAMS
from stepdiag_ros.nodes.onlooker import ViewerNode
from stepdiag_ros.nodes.operator import OperatorNode
from stepdiag_ros.processes.cell import simulated_cell
from stepdiag_ros.processes.node_process import OVERRIDE, NodeProcess, Processes
from stepdiag_ros.viewers.page.state import PageState as MonitorState

FOLDER = Path(__file__).parents[2] / "config" / "security"
POLICY = FOLDER / "stepdiag.policy.xml"
INCLUDE = "{http://www.w3.org/2001/XInclude}include"
PEOPLE = ("operator", "viewer", "maintenance", "launch")
"""Enclaves of those who are no nodes of the suite."""

Rule = tuple[str, str]
"""What is done (publish, subscribe, reply, request), and the name of the topic or service."""

ACTION = {
    "reply": ("cancel_goal", "get_result", "send_goal"),
    "publish": ("feedback", "status"),
}


def rules_of(profile: ElementTree.Element) -> set[Rule]:
    """Return what a profile allows, with names in full."""
    found: set[Rule] = set()
    node = profile.get("node")
    namespace = str(profile.get("ns")).rstrip("/")

    def full(name: str) -> str:
        if name.startswith("~"):
            return f"{namespace}/{node}{name[1:]}"
        return name if name.startswith("/") else f"{namespace}/{name}"

    def read(element: ElementTree.Element) -> None:
        for part in element:
            if part.tag == INCLUDE:
                assert part.get("xpointer") == "xpointer(/profile/*)"
                read(ElementTree.parse(FOLDER / str(part.get("href"))).getroot())
                continue
            ((how, allowed),) = part.attrib.items()
            assert allowed == "ALLOW"
            for each in part:
                name = full(str(each.text))
                if part.tag == "actions":
                    found.update(action_rules(how, name))
                else:
                    found.add((how, name))

    read(profile)
    return found


def action_rules(how: str, name: str) -> set[Rule]:
    server = {"reply": "reply", "publish": "publish"}
    client = {"reply": "request", "publish": "subscribe"}
    side = server if how == "execute" else client
    return {
        (side[kind], f"{name}/_action/{part}") for kind, parts in ACTION.items() for part in parts
    }


def policy() -> dict[str, set[Rule]]:
    """Return what each enclave is allowed."""
    found: dict[str, set[Rule]] = {}
    for enclave in ElementTree.parse(POLICY).getroot().iterfind("enclaves/enclave"):
        (profile,) = enclave.iterfind("profiles/profile")
        found[str(enclave.get("path"))] = rules_of(profile)
    return found


def class_of(module: str) -> Callable[[], Any]:
    """Return the node class of a module."""
    loaded = import_module(f"stepdiag_ros.nodes.{module}")
    (found,) = (
        each
        for each in vars(loaded).values()
        if isinstance(each, type)
        and issubclass(each, StepdiagNode)
        and each.__module__ == loaded.__name__
    )
    return found


def endpoints(process: NodeProcess) -> set[Rule]:
    """Return what a node has, once a device it may own is in use."""
    import rclpy

    # In real time, because nobody here tells a simulated one; /clock is then not listened to.
    given = {**process.parameters, **({"use_sim_time": False} if process.parameters else {})}
    command = NodeProcess(process.name, given).command()
    rclpy.init(args=command[command.index("--ros-args") :])
    return endpoints_of(class_of(process.name)(), process.name)


def endpoints_of(node, role: str) -> set[Rule]:
    """Return what a node has, and end it."""
    import rclpy

    try:
        end = time.monotonic() + PATIENCE
        while getattr(node, "active", True) is False and time.monotonic() < end:
            rclpy.spin_once(node, timeout_sec=0.05)
        assert getattr(node, "active", True), f"{role} did not open its device"
        if role == "foxglove_server":
            # What it hears only while a viewer wants it.
            for topic in STREAMS:
                node.hear(topic, wanted=True)
        name, namespace = node.get_name(), node.get_namespace()
        questions = {
            "publish": node.get_publisher_names_and_types_by_node,
            "subscribe": node.get_subscriber_names_and_types_by_node,
            "reply": node.get_service_names_and_types_by_node,
            "request": node.get_client_names_and_types_by_node,
        }
        return {(how, found) for how, ask in questions.items() for found, _ in ask(name, namespace)}
    finally:
        node.close()
        node.destroy_node()
        rclpy.try_shutdown()


def processes(folder: Path) -> dict[str, NodeProcess]:
    cell = simulated_cell("quick", "demo", "demo", folder, 1.0, 0.0, 1)
    others = [
        NodeProcess("scene"),
        NodeProcess("by_hand"),
        NodeProcess("monitor", {"port": 0}),
        NodeProcess("foxglove_server", {"port": 0}),
        NodeProcess("archive", {"place": str(folder)}),
    ]
    return {process.name: process for process in [*cell, *others]}


def test_every_node_has_its_enclave_and_everyone_else_is_known(tmp_path: Path) -> None:
    assert set(processes(tmp_path)) == set(NODES)
    assert set(policy()) == {f"/stepdiag/{name}" for name in (*NODES, *PEOPLE)}
    for name, process in processes(tmp_path).items():
        assert ["--enclave", f"/stepdiag/{name}"] == process.command()[4:6]


@pytest.mark.parametrize("name", NODES)
def test_a_node_is_allowed_what_it_does_and_nothing_else(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", [name])
    process = processes(tmp_path)[name]
    allowed = policy()[process.enclave]
    done = endpoints(process) | {("subscribe", "/clock")}
    refused = {
        (how, what)
        for how, what in done
        if not any(how == way and fnmatchcase(what, pattern) for way, pattern in allowed)
    }
    assert not refused, f"{POLICY.name} does not allow {name} to {sorted(refused)}"
    # Only the rclpy of later ROS 2 describes types; the recorder asks the nodes that it meets.
    needless = {
        (how, pattern)
        for how, pattern in allowed
        if not any(how == way and fnmatchcase(what, pattern) for way, what in done)
        and not pattern.endswith("/get_type_description")
        and not (name == "recorder" and how == "request")
    }
    assert not needless, f"{POLICY.name} allows {name} without need to {sorted(needless)}"


def who_may(how: str, name: str) -> set[str]:
    return {
        path.rpartition("/")[2]
        for path, rules in policy().items()
        for way, pattern in rules
        if way == how and fnmatchcase(name, pattern)
    }


def test_only_the_sequencer_commands_motion() -> None:
    # Nothing moves without its permit; a run measured by hand is only told of.
    assert who_may("publish", "/machine/permit") == {"sequencer"}
    assert who_may("publish", "/machine/command") == {"sequencer", "by_hand"}
    assert who_may("publish", "/run/state") == {"sequencer", "by_hand"}
    assert who_may("publish", "/machine/command_status") == {"bridge", "by_hand"}
    assert who_may("publish", "/machine/state") == {"bridge"}
    assert who_may("publish", "/joint_states") == {"bridge"}
    assert who_may("publish", "/interferometer/reading") == {"interferometer"}
    assert who_may("publish", "/clock") == {"clock"}


def test_who_may_stop_start_and_change() -> None:
    stopping = {"sequencer", "operator", "maintenance"}
    assert who_may("request", "/cnc_bridge/stop") == stopping
    # The live page passes on what an operator with its token asks for.
    for service in ("start", "resume", "pause", "abort"):
        assert who_may("request", f"/sequencer/{service}") == {"operator", "monitor"}
    assert who_may("request", "/sequencer/measure/_action/send_goal") == {"operator"}
    for service in ("start", "resume", "abort"):
        assert who_may("request", f"/by_hand/{service}") == {"operator", "monitor"}
    for service in ("set_parameters", "set_parameters_atomically", "change_state"):
        leading = {"launch"} if service == "change_state" else set()
        assert who_may("request", f"/cnc_bridge/{service}") == {"maintenance"} | leading
    # Nobody answers in the name of another.
    for service in ("cnc_bridge/stop", "cnc_bridge/change_state"):
        assert who_may("reply", f"/{service}") == {"bridge"}
    assert who_may("reply", "/sequencer/start") == {"sequencer"}


def test_the_override_of_a_command_is_not_for_its_nodes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(OVERRIDE, "/stepdiag/operator")
    seen: list[dict[str, str]] = []
    monkeypatch.setattr(subprocess, "Popen", lambda *_, env, **__: seen.append(env))
    Processes([], tmp_path).start(NodeProcess("solver"))
    assert seen[0][OVERRIDE] == "" and seen[0]["PATH"]


def test_who_looks_on_publishes_nothing_of_a_run() -> None:
    own = {"/rosout", "/parameter_events", "/diagnostics"}
    for name in (*PEOPLE, "foxglove_server"):
        published = {what for how, what in policy()[f"/stepdiag/{name}"] if how == "publish"}
        assert published == own
    # Foxglove's viewers log in nowhere; whoever serves them must not be able to ask for anything.
    requested = {what for how, what in policy()["/stepdiag/foxglove_server"] if how == "request"}
    assert requested == {what for how, what in policy()["/stepdiag/scene"] if how == "request"}


@pytest.mark.parametrize(
    ("enclave", "make"),
    [
        ("operator", OperatorNode),
        ("viewer", lambda: ViewerNode(MonitorState(), 4.0, lambda _: False)),
    ],
)
def test_the_nodes_of_commands_are_allowed_what_they_do(
    enclave: str, make: Callable[[], Any]
) -> None:
    import rclpy

    rclpy.init(args=["--ros-args", "--enclave", f"/stepdiag/{enclave}"])
    done = endpoints_of(make(), enclave)
    allowed = policy()[f"/stepdiag/{enclave}"]
    refused = {
        (how, what)
        for how, what in done
        if not any(how == way and fnmatchcase(what, pattern) for way, pattern in allowed)
    }
    assert not refused, f"{POLICY.name} does not allow {enclave} to {sorted(refused)}"
    assert ("subscribe", "/run/state") in done
    asked = {what for how, what in done if how == "request"}
    assert not asked or enclave == "operator"
