"""A recorded run into a live graph, with the nodes that evaluate it to compare if wanted."""

import tempfile
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stepdiag_ros import topics
from stepdiag_ros.processes.graph import in_graph
from stepdiag_ros.processes.node_process import NodeProcess, Processes

if TYPE_CHECKING:
    from stepdiag_ros.bags.bag import Bag
    from stepdiag_ros.bags.runs import FoundRun
    from stepdiag_ros.nodes.player import Played

START_LIMIT = 20.0
"""Real seconds within which the nodes that evaluate must be up."""
LISTENERS_LIMIT = 60.0
"""The same for nodes that somebody else starts, maybe by hand, maybe after this."""
LIVE = ("cnc_bridge", "sequencer")
"""Roles of nodes beside which no run is replayed: what is recorded would be taken for real."""
QUIET = 2.0
"""Real seconds without a new message after which the nodes that evaluate are taken to be done."""
PATIENCE = 20.0
"""The same while a message is missing: a busy computer lets nodes wait."""

_FROM_LINES = (topics.VOLUMETRIC_ERRORS, topics.POSITIONING_TEST, topics.DIAGNOSIS)
_FROM_READINGS = (topics.STOP, topics.BLOCK, topics.LINE, *_FROM_LINES)


def replay(
    bag: "Bag",
    rate: float,
    check: bool,
    progress: Callable[[float], None],
    listeners: Sequence[str] = (),
    run_id: str | None = None,
) -> "Played":
    """Publish a bag into the live graph.

    Args:
        bag: the recorded run.
        rate: recorded seconds in a real second; 0 for as fast as possible.
        check: start an assembler, a solver, an evaluator and (where the bag holds a diagnosis) a
            diagnosis, and compare their messages with the recorded ones.
        progress: called with the part that has been published, 0..1.
        listeners: roles of nodes, started by somebody else, without which nothing is published.
        run_id: which run, where the bag holds several.

    Raises:
        ValueError: the bag holds no run, or several and none is named, or one of a newer schema
            version, or (with ``check``) nothing to compare with; or a node could not be started.
    """
    from stepdiag_ros.bags.run import check_version
    from stepdiag_ros.bags.runs import choose_run
    from stepdiag_ros.nodes.player import PlayerNode

    present = {found[0] for name in bag.topics if (found := topics.topic_of(name)) is not None}
    run = choose_run(bag, run_id)
    version, software_version = run.description.schema_version, run.description.software_version
    check_version(bag.path, version, software_version)
    # Without one of these there is nothing to assemble, and without the run's beginning what is
    # assembled has another zero; the recorded lines are taken then.
    streams = {topics.READING, topics.MACHINE_COMMAND, topics.COMMAND_STATUS}
    late = _is_late(bag, run)
    assembled = present >= streams and not late
    compared = _FROM_READINGS if assembled else _FROM_LINES
    if check and not present.intersection(compared):
        raise ValueError(
            f"{bag.path} holds no stops, lines or results that follow from what it can replay;"
            " there is nothing to compare: replay it without --check"
        )
    parameters: dict[str, dict[str, object]] = {
        role: {"use_sim_time": True}
        for role in (*(["assembler"] if assembled else []), "solver", "evaluator")
    }
    with ExitStack() as stack:
        stack.enter_context(in_graph())
        player = PlayerNode(bag, run, derived=not assembled, late=late)
        player.refuse_company(LIVE)
        player.open()
        if check:
            logs = Path(stack.enter_context(tempfile.TemporaryDirectory()))
            parameters["solver"] |= _judged_by(bag, run)
            if topics.DIAGNOSIS in present:
                parameters["diagnosis"] = {"use_sim_time": True, **_compared_as(bag, run, logs)}
            roles = list(parameters)
            player.refuse_company(roles)
            # Before the nodes are there: what a node publishes to listeners that it has not found
            # yet is lost.
            player.listen_to_derived(compared)
            nodes = [NodeProcess(role, given) for role, given in parameters.items()]
            processes = stack.enter_context(Processes(nodes, logs))
            player.wait_for(roles, START_LIMIT, lambda: "; ".join(processes.ended().values()))
        if listeners:
            player.wait_for(listeners, LISTENERS_LIMIT, lambda: "")
        played = player.play(rate, progress)
        return player.compare(played, QUIET, PATIENCE) if check else played


def _is_late(bag: "Bag", run: "FoundRun") -> bool:
    """Say whether the recording began after the run did: its first commands are missing."""
    from stepdiag_ros.bags.runs import full_names, messages_of

    names = full_names(bag, topics.MACHINE_COMMAND)
    first = next((message for _, message in messages_of(bag, run, names)), None)
    return bool(names) and (first is None or first.command_id > 1)


def _judged_by(bag: "Bag", run: "FoundRun") -> dict[str, object]:
    """Return the tolerance by which a recorded run was judged; nothing where none was agreed."""
    verdict = _last(bag, run, topics.RUN_VERDICT)
    return {} if verdict is None or isnan(verdict.tolerance) else {"tolerance": verdict.tolerance}


def _compared_as(bag: "Bag", run: "FoundRun", folder: Path) -> dict[str, object]:
    """Return the parameters with which the diagnosis of a recorded run was made.

    The model of the machine is written into the folder: what is recorded is the text of it.
    """
    last = _last(bag, run, topics.DIAGNOSIS)
    if last is None:
        return {}
    model = folder / "model.yaml"
    model.write_text(last.model, encoding="utf-8")
    return {"model": model, "seed": int(last.seed)}


def _last(bag: "Bag", run: "FoundRun", topic: topics.Topic) -> Any:
    """Return the last message of a topic in a run; None without one."""
    from stepdiag_ros.bags.runs import full_names, messages_of

    last = None
    for _, message in messages_of(bag, run, full_names(bag, topic)):
        last = message
    return last
