"""A recorded run into a live graph, with the nodes that evaluate it to compare if wanted."""

import tempfile
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from stepdiag_ros import topics
from stepdiag_ros.session.graph import in_graph
from stepdiag_ros.session.processes import NodeProcess, Processes

if TYPE_CHECKING:
    from stepdiag_ros.bags.reader import BagReader
    from stepdiag_ros.nodes.player import Played

START_LIMIT = 20.0
"""Real seconds within which the nodes that evaluate must be up."""
QUIET = 2.0
"""Real seconds without a new message after which the nodes that evaluate are taken to be done."""

_FROM_LINES = (topics.VOLUMETRIC_ERRORS, topics.POSITIONING_TEST, topics.DIAGNOSIS)
_FROM_READINGS = (topics.STOP, topics.BLOCK, topics.LINE, *_FROM_LINES)


def replay(
    bag: "BagReader", rate: float, check: bool, progress: Callable[[float], None]
) -> "Played":
    """Publish a bag into the live graph.

    Args:
        bag: the recorded run.
        rate: recorded seconds in a real second; 0 for as fast as possible.
        check: start an assembler, a solver, an evaluator and (where the bag holds a diagnosis) a
            diagnosis, and compare their messages with the recorded ones.
        progress: is told the part that has been published, 0..1.

    Raises:
        ValueError: the bag holds no run, or one of a newer schema version, or (with ``check``)
            nothing to compare with; or a node could not be started.
    """
    from stepdiag_ros.bags.run import check_version
    from stepdiag_ros.nodes.player import PlayerNode

    present = {found[0] for name in bag.topics if (found := topics.topic_of(name)) is not None}
    if topics.RUN_DESCRIPTION not in present:
        raise ValueError(f"{bag.path} holds no run: there is no RunDescription in it")
    check_version(bag.path, bag.header.schema_version, bag.header.software_version)
    # Without one of these there is nothing to assemble; the recorded lines are taken then.
    assembled = present >= {topics.READING, topics.MACHINE_COMMAND, topics.COMMAND_STATUS}
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
        player = PlayerNode(bag, derived=not assembled)
        if check:
            logs = Path(stack.enter_context(tempfile.TemporaryDirectory()))
            if topics.DIAGNOSIS in present:
                parameters["diagnosis"] = {"use_sim_time": True, **_compared_as(bag, logs)}
            roles = list(parameters)
            player.refuse_company(roles)
            nodes = [NodeProcess(role, given) for role, given in parameters.items()]
            processes = stack.enter_context(Processes(nodes, logs))
            player.wait_for(roles, START_LIMIT, processes.ended)
            player.listen_to_derived(compared)
        played = player.play(rate, progress)
        return player.compare(played, QUIET) if check else played


def _compared_as(bag: "BagReader", folder: Path) -> dict[str, object]:
    """Return the parameters with which the diagnosis of a recorded run was made.

    The model of the machine is written into the folder: what is recorded is the text of it.
    """
    names = [name for name in bag.topics if _is_diagnosis(name)]
    last = None
    for _, message in bag.messages(topics=names):
        last = message
    if last is None:
        return {}
    model = folder / "model.yaml"
    model.write_text(last.model, encoding="utf-8")
    return {"model": model, "seed": int(last.seed)}


def _is_diagnosis(name: str) -> bool:
    found = topics.topic_of(name)
    return found is not None and found[0] is topics.DIAGNOSIS
