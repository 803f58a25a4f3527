"""Sections about what follows: error curves, squareness, the gap to the model, faults."""

from collections.abc import Iterable
from typing import Any, ClassVar, NamedTuple

import numpy as np

from stepdiag_ros.evaluation.report import short_title
from stepdiag_ros.metrology.discrepancy import NOT_TESTABLE
from stepdiag_ros.metrology.discrepancy.summary import DiagnosisSummary, FoundEffect, GapFigures
from stepdiag_ros.metrology.forward import AXES_OF
from stepdiag_ros.metrology.geometry import (
    AXES,
    ROTATIONS,
    SQUARENESS,
    TRANSLATIONS,
    Vector,
    moving_axis,
)
from stepdiag_ros.metrology.solvers.result import VolumetricErrors
from stepdiag_ros.metrology.standards.volumetric import of_result
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR
from stepdiag_ros.metrology.units import IN_MICRO, IN_MILLI
from stepdiag_ros.run.health import Level
from stepdiag_ros.run.sequence import State
from stepdiag_ros.run.supervision import BYSTANDERS, HEARTBEAT
from stepdiag_ros.text.numbers import UNKNOWN, plain, plus_minus
from stepdiag_ros.viewers.page.contact import Contact, SilentNode
from stepdiag_ros.viewers.page.course import ENDED
from stepdiag_ros.viewers.page.items import MachineStatus, RunBegin, RunStatus, Said, WorstError
from stepdiag_ros.viewers.page.section import PageSection, drawn, micrometres
from stepdiag_ros.viewers.scene.error_markers import chosen_results

_MOST_FAULTS = 40
"""Faults that are listed; more are counted."""
_NO_ERROR = {"text": UNKNOWN, "value": None, "where": "", "curve": "", "limit": False}
"""Headline before any error is determined."""


class _ResultSection(PageSection):
    """A section that is made of the result to rely on."""

    def begin(self, run: RunBegin | None) -> None:
        """Start without a result."""
        del run
        self._results: dict[str, VolumetricErrors] = {}

    def take(self, item: object) -> bool:
        """Take the newest result of each method."""
        if not isinstance(item, VolumetricErrors):
            return False
        self._results[item.method] = item
        return True

    @property
    def result(self) -> VolumetricErrors | None:
        """Return the result to rely on of those there are."""
        chosen = chosen_results(self._results, "preferred")
        return chosen[0] if chosen else None


class CurveSection(_ResultSection):
    """The nine error curves so far, with U (95 %)."""

    name: ClassVar[str] = "curves"

    def begin(self, run: RunBegin | None) -> None:
        """Start without a result."""
        super().begin(run)
        self._before: dict[str, VolumetricErrors] = {}

    def take(self, item: object) -> bool:
        """Take the newest result of each method, and keep the one of fewer lines before it."""
        if isinstance(item, VolumetricErrors):
            last = self._results.get(item.method)
            if last is not None and last.lines < item.lines:
                self._before[item.method] = last
        return super().take(item)

    def document(self) -> dict[str, Any]:
        """Return each curve over its axis: mm and µm."""
        result = self.result
        if result is None:
            return {"method": "", "lines": 0, "curves": [], "not_determined": [], "remarks": []}
        return {
            "method": short_title(result.method),
            "lines": result.lines,
            # Of a tracker's seven lines there are figures and no curves.
            "curves": [self._curve(result, name) for name in TRANSLATIONS if result.curves],
            "not_determined": list(result.not_determined),
            "remarks": list(result.remarks),
        }

    def _curve(self, result: VolumetricErrors, name: str) -> dict[str, Any]:
        axis = moving_axis(name)
        nodes = result.nodes[axis]
        values = result.curves.get(name)
        spread = result.standard_uncertainty.get(name)
        nothing = [None] * len(nodes)
        known = _known(values, spread)
        if known == "none":
            # What the frame fixes at its ends tells nothing of the curve.
            values = spread = None
        return {
            "name": name,
            "axis": AXES[axis],
            "known": known,
            "positions": [drawn(float(node), IN_MILLI) for node in nodes],
            "values": nothing if values is None else [drawn(float(v), IN_MICRO) for v in values],
            "uncertainty": nothing
            if spread is None
            else [drawn(float(u), IN_MICRO * COVERAGE_FACTOR) for u in spread],
            "worst": self._worst(result, name),
        }

    def _worst(self, result: VolumetricErrors, name: str) -> dict[str, Any] | None:
        """Return the value farthest from zero, and whether it grows from result to result."""
        worst = _farthest(result, name)
        if worst is None:
            return None
        before = self._before.get(result.method)
        earlier = None if before is None else _farthest(before, name)
        # Of a curve that is known in part, the farthest may be where nothing is known.
        whole = _is_whole(result, name) and before is not None and _is_whole(before, name)
        place = float(result.nodes_of(name)[worst.node])
        return {
            "text": micrometres(worst.value, COVERAGE_FACTOR * worst.standard_uncertainty),
            "at": drawn(place, IN_MILLI),
            "trend": _trend(earlier, worst) if earlier is not None and whole else None,
        }


class _Farthest(NamedTuple):
    """The value of a curve that is farthest from zero: at which node, m, and its u, m."""

    node: int
    value: float
    standard_uncertainty: float


def _farthest(result: VolumetricErrors, name: str) -> _Farthest | None:
    values = result.curves.get(name)
    spread = result.standard_uncertainty.get(name)
    if values is None or spread is None or _known(values, spread) == "none":
        return None
    node = int(np.nanargmax(np.abs(values)))
    return _Farthest(node, float(values[node]), float(spread[node]))


def _is_whole(result: VolumetricErrors, name: str) -> bool:
    values, spread = result.curves.get(name), result.standard_uncertainty.get(name)
    return _known(values, spread) == "all"


def _trend(earlier: _Farthest, now: _Farthest) -> str | None:
    """Return whether a value has moved away from zero; None if undetermined.

    The later of two results holds the readings of the earlier one, so that u² of their difference
    is the earlier u² less the later: more than the earlier U (95 %) is not chance.
    """
    allowed = COVERAGE_FACTOR * earlier.standard_uncertainty
    if not np.isfinite(allowed):
        return None
    growth = abs(now.value) - abs(earlier.value)
    if abs(growth) <= allowed:
        return "steady"
    return "grows" if growth > 0.0 else "shrinks"


def _known(values: Vector | None, spread: Vector | None) -> str:
    """Say how much is known of a curve: all, part or none; what the frame fixes does not count."""
    if values is None or spread is None:
        return "none"
    known = np.isfinite(values)
    if np.all(known):
        return "all"
    return "part" if np.any(known & (spread != 0.0)) else "none"


class WorstSection(_ResultSection):
    """The largest error so far: in the volume, or of a single curve while others are unknown."""

    name: ClassVar[str] = "worst"

    def begin(self, run: RunBegin | None) -> None:
        """Forget all results, and take up the machine of a run."""
        super().begin(run)
        self._chain = run.chain if run else ""
        self._told: WorstError | None = None

    def take(self, item: object) -> bool:
        """Take the largest error by the solver, and the results, which serve without it."""
        if not isinstance(item, WorstError):
            return super().take(item)
        self._told = item
        return True

    def document(self) -> dict[str, Any]:
        """Return its size with U (95 %), where it is, and the curve if it is of one alone.

        ``limit``: U is what it cannot exceed, however the errors of the curves are correlated.
        """
        result, told = self.result, self._told
        if told is not None and np.isfinite(told.value):
            return _document(told.value, told.expanded_uncertainty, told.place)
        if result is None:
            return _NO_ERROR
        return self._in_volume(result) or self._of_one_curve(result)

    def _in_volume(self, result: VolumetricErrors) -> dict[str, Any] | None:
        turns = any(name in ROTATIONS for name in result.curves)
        if not result.curves or (turns and not self._chain):
            return None
        found = of_result(result, self._chain)
        if not np.isfinite(found.value):
            return None
        # A message holds no covariance; without it the uncertainties of the curves give a limit.
        limited = not np.isfinite(found.standard_uncertainty)
        spread = found.uncertainty_limit if limited else found.standard_uncertainty
        return _document(found.value, COVERAGE_FACTOR * spread, found.position, limited)

    def _of_one_curve(self, result: VolumetricErrors) -> dict[str, Any]:
        known = {name: _farthest(result, name) for name in TRANSLATIONS}
        found = {name: one for name, one in known.items() if one is not None}
        if not found:
            return _NO_ERROR
        name = max(found, key=lambda one: abs(found[one].value))
        worst = found[name]
        place = float(result.nodes_of(name)[worst.node])
        return {
            "text": micrometres(worst.value, COVERAGE_FACTOR * worst.standard_uncertainty),
            "value": drawn(worst.value, IN_MICRO),
            "where": f"{AXES[moving_axis(name)]} {plain(place * IN_MILLI, 1)} mm",
            "curve": name,
            "limit": False,
        }


def _document(
    value: float, expanded_uncertainty: float, place: Iterable[float], limited: bool = False
) -> dict[str, Any]:
    places = (f"{letter} {plain(at * IN_MILLI, 1)}" for letter, at in zip(AXES, place, strict=True))
    return {
        "text": micrometres(value, expanded_uncertainty),
        "value": drawn(value, IN_MICRO),
        "where": f"{', '.join(places)} mm",
        "curve": "",
        "limit": limited,
    }


class SquarenessSection(_ResultSection):
    """Squareness of the three pairs of axes, and of a tracker's seven lines positioning."""

    name: ClassVar[str] = "squareness"

    def document(self) -> dict[str, Any]:
        """Return each with U (95 %): squareness as a right-handed rotation, in µm/m."""
        result = self.result
        figures = {figure.name: figure for figure in result.figures} if result else {}
        shown = []
        for name in SQUARENESS:
            reference, other = AXES_OF[name]
            figure = figures.get(name)
            text = UNKNOWN
            if figure is not None:
                text = plus_minus(figure.value, figure.standard_uncertainty, IN_MICRO)
            shown.append(
                {
                    "name": name,
                    "words": f"{other} to {reference}",
                    "text": text if text == UNKNOWN else f"{text} µm/m",
                    "value": drawn(figure.value, IN_MICRO) if figure else None,
                }
            )
        for name in (f"positioning E_{axis}{axis}" for axis in AXES):
            if result is not None and not result.curves and name in figures:
                one = figures[name]
                value = plus_minus(one.value, one.standard_uncertainty, IN_MICRO)
                shown.append(
                    {
                        "name": name.removeprefix("positioning "),
                        "words": "positioning",
                        "text": value if value == UNKNOWN else f"{value} µm",
                        "value": drawn(one.value, IN_MICRO),
                    }
                )
        return {"figures": shown, "method": short_title(result.method) if result else ""}


class VerdictSection(PageSection):
    """The gap between run and model, and what the diagnosis makes of it."""

    name: ClassVar[str] = "verdict"

    def begin(self, run: RunBegin | None) -> None:
        """Start without a diagnosis."""
        del run
        self._summary: DiagnosisSummary | None = None

    def take(self, item: object) -> bool:
        """Take the newest diagnosis."""
        if not isinstance(item, DiagnosisSummary):
            return False
        self._summary = item
        return True

    def document(self) -> dict[str, Any]:
        """Return verdict, gap and findings in words."""
        told = self._summary
        if told is None:
            return {"verdict": None, "sentence": "no pass has been compared with the model yet"}
        if told.verdict == NOT_TESTABLE and not told.run_over and told.lines < told.lines_planned:
            # The lines that are left may tell it; advice is for a plan that is measured.
            lines = f"{told.lines} of {told.lines_planned} passes"
            sentence = f"not yet: {lines} do not show whether model and run agree"
            return {"verdict": None, "sentence": sentence}
        return {
            "verdict": told.verdict,
            "sentence": told.sentence,
            "final": told.run_over,
            "lines": told.lines,
            "lines_planned": told.lines_planned,
            "model": told.model.name,
            "gap": _gap(told.before),
            # Without a finding the gap that is left is the gap there is.
            "gap_left": _gap(told.after) if told.findings or told.partial else None,
            "where": list(told.where),
            "findings": [_finding(one) for one in told.findings],
        }


def _gap(gap: GapFigures) -> dict[str, str]:
    return {"rms": micrometres(gap.rms), "largest": micrometres(gap.largest)}


def _finding(effect: FoundEffect) -> dict[str, Any]:
    sizes = []
    for size in effect.sizes:
        scaled = size.unit in ("m", "rad")
        number = plus_minus(size.value, size.standard_uncertainty, IN_MICRO if scaled else 1.0)
        sizes.append(f"{size.meaning}: {number} {'µ' if scaled else ''}{size.unit}".rstrip())
    return {"label": effect.label, "sentence": effect.sentence, "sizes": sizes}


class FaultSection(PageSection):
    """All faults, and what is only starting, in the words of the node that reports them."""

    name: ClassVar[str] = "faults"
    of_run = False

    def begin(self, run: RunBegin | None) -> None:
        """Know of no fault."""
        del run
        self._said: dict[str, Said] = {}
        self._contact: Contact | None = None
        self._status: RunStatus | None = None
        self._run = ""
        self._machine: MachineStatus | None = None
        self._heard = False

    def take(self, item: object) -> bool:
        """Take what nodes, the run and the machine complain of."""
        heard = isinstance(item, (Said, RunStatus, MachineStatus))
        news = heard and not self._heard
        self._heard = self._heard or heard
        return self._fold(item) or news

    def _fold(self, item: object) -> bool:
        if isinstance(item, Said):
            before = self._said.get(item.name)
            if item.level == Level.OK:
                return self._said.pop(item.name, None) is not None
            self._said[item.name] = item
            return item != before
        if isinstance(item, Contact):
            told = self._missed(), self._note()
            self._contact = item
            # What a node said before it fell silent holds no more.
            gone = {node.name.lstrip("/") for node in item.silent}
            forgotten = [one for one in self._said if one.partition(": ")[0] in gone]
            for name in forgotten:
                del self._said[name]
            return bool(forgotten) or (self._missed(), self._note()) != told
        if isinstance(item, RunStatus):
            shown = self._run, self._missed(), self._note(), self._machine_words()
            self._status = item
            self._run = item.text if item.state is State.FAULT else ""
            now = self._run, self._missed(), self._note(), self._machine_words()
            return now != shown
        if isinstance(item, MachineStatus):
            words, self._machine = self._machine_words(), item
            return self._machine_words() != words
        return False

    def _machine_words(self) -> str:
        """Return what is wrong with the machine; after an abort it stands, as was asked for."""
        machine = self._machine
        if machine is None or not machine.troubled:
            return ""
        aborted = self._status is not None and self._status.state is State.ABORTED
        if aborted and not machine.faulty:
            return ""
        return machine.reason or "the machine is stopped"

    def document(self) -> dict[str, Any]:
        """Return faults first, then warnings; and apart from both, what is starting."""
        found = []
        if self._run:
            found.append({"level": "fault", "who": "run", "text": self._run})
        machine = self._machine_words()
        # The bridge may say the same, and what it does about it.
        if machine and not any(one.message.startswith(machine) for one in self._said.values()):
            found.append({"level": "fault", "who": "machine", "text": machine})
        missed = [f"{node.role} node {node.name}" for node in self._missed()]
        if missed:
            verb = "is" if len(missed) == 1 else "are"
            text = f"{', '.join(missed)} {verb} silent"
            found.append({"level": "fault", "who": "nodes", "text": text})
        found += self._said_by_nodes()
        return {
            "faults": found[:_MOST_FAULTS],
            "more": max(0, len(found) - _MOST_FAULTS),
            "starting": self._starting()[:_MOST_FAULTS],
            "note": self._note(),
        }

    def _starting(self) -> list[dict[str, str]]:
        """Return the nodes that are starting: each once, with what it waits for."""
        waits: dict[str, dict[str, str]] = {}
        for said in self._said.values():
            if said.starting:
                node, _, task = said.name.rpartition(": ")
                waits.setdefault(node, {})[task] = said.message
        # The tasks of a node that is not ready wait for the node.
        return [
            {"who": node, "text": tasks.get(HEARTBEAT) or "; ".join(dict.fromkeys(tasks.values()))}
            for node, tasks in waits.items()
        ]

    def _said_by_nodes(self) -> list[dict[str, str]]:
        """Return what nodes say, faults first; each thing once, with all tasks that say it."""
        who: dict[tuple[bool, str, str], list[str]] = {}
        for said in self._said.values():
            if said.starting:
                continue
            node, _, task = said.name.rpartition(": ")
            tasks = who.setdefault((said.level != Level.ERROR, node, said.message), [])
            tasks += [task] if task != HEARTBEAT else []
        return [
            {
                "level": "warning" if mild else "fault",
                "who": f"{node}: {', '.join(tasks)}" if tasks else node,
                "text": text,
            }
            for (mild, node, text), tasks in sorted(who.items(), key=lambda one: one[0][0])
        ]

    @property
    def _is_over(self) -> bool:
        return self._status is not None and self._status.state in ENDED

    def _missed(self) -> tuple[SilentNode, ...]:
        """Return the silent nodes that a run needs, and that have not ended with theirs."""
        if self._contact is None or (self._is_over and not self._contact.at_work):
            return ()
        return tuple(node for node in self._contact.silent if node.role not in BYSTANDERS)

    def _note(self) -> str:
        """Return notes that are not faults, but state how complete the list of faults is."""
        contact = self._contact
        if contact is None:
            # A bag has no contact; what it holds was heard when it was recorded.
            return "" if self._heard else "no message yet"
        if not contact.known:
            return (
                "no node found. Start a run with 'stepdiag run', or nodes with 'stepdiag cell' or a"
                " launch file and then a run with 'stepdiag measure'"
            )
        gone = self._is_over and not contact.at_work and bool(contact.silent)
        return "the run is over, and its nodes have ended" if gone else ""
