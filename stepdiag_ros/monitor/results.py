"""Sections about what follows: error curves, squareness, the gap to the model, faults."""

from typing import Any, ClassVar

import numpy as np

from stepdiag_ros.diagnosis_summary import DiagnosisSummary, FoundEffect, GapFigures
from stepdiag_ros.metrology.geometry import (
    AXES,
    SQUARENESS,
    TRANSLATIONS,
    Vector,
    moving_axis,
)
from stepdiag_ros.metrology.solvers.result import VolumetricErrors
from stepdiag_ros.monitor.items import MachineStatus, RunBegin, RunStatus, Said, Silent
from stepdiag_ros.monitor.section import MICRO, MILLI, Section, drawn, micrometres
from stepdiag_ros.report.content import short_title
from stepdiag_ros.report.numbers import COVERAGE_FACTOR, UNKNOWN, plus_minus
from stepdiag_ros.report.squareness import AXES_OF
from stepdiag_ros.run.health import Level
from stepdiag_ros.run.sequence import State
from stepdiag_ros.run.supervision import HEARTBEAT
from stepdiag_ros.scene.error_markers import chosen_results

_MOST_FAULTS = 40
"""Faults that are listed; more are counted."""


class _ResultSection(Section):
    """A section that is made of the result to rely on."""

    def begin(self, run: RunBegin | None) -> None:
        """Know no result."""
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

    def document(self) -> dict[str, Any]:
        """Return each curve over its axis: mm and µm."""
        result = self.result
        if result is None:
            return {"method": "", "lines": 0, "curves": [], "not_determined": [], "remarks": []}
        return {
            "method": short_title(result.method),
            "lines": result.lines,
            "curves": [self._curve(result, name) for name in TRANSLATIONS],
            "not_determined": list(result.not_determined),
            "remarks": list(result.remarks),
        }

    @staticmethod
    def _curve(result: VolumetricErrors, name: str) -> dict[str, Any]:
        axis = moving_axis(name)
        nodes = result.nodes[axis]
        values = result.curves.get(name)
        spread = result.standard_uncertainty.get(name)
        nothing = [None] * len(nodes)
        return {
            "name": name,
            "axis": AXES[axis],
            "known": _known(values, spread),
            "positions": [drawn(float(node), MILLI) for node in nodes],
            "values": nothing if values is None else [drawn(float(v), MICRO) for v in values],
            "uncertainty": nothing
            if spread is None
            else [drawn(float(u), MICRO * COVERAGE_FACTOR) for u in spread],
        }


def _known(values: Vector | None, spread: Vector | None) -> str:
    """Say how much is known of a curve: all, part or none; what the frame fixes does not count."""
    if values is None or spread is None:
        return "none"
    known = np.isfinite(values)
    if np.all(known):
        return "all"
    return "part" if np.any(known & (spread != 0.0)) else "none"


class SquarenessSection(_ResultSection):
    """Squareness of the three pairs of axes."""

    name: ClassVar[str] = "squareness"

    def document(self) -> dict[str, Any]:
        """Return each with U (95 %), in µm/m, as a right-handed rotation."""
        result = self.result
        figures = {figure.name: figure for figure in result.figures} if result else {}
        shown = []
        for name in SQUARENESS:
            reference, other = AXES_OF[name]
            figure = figures.get(name)
            text = UNKNOWN
            if figure is not None:
                text = plus_minus(figure.value, figure.standard_uncertainty, MICRO)
            shown.append(
                {
                    "name": name,
                    "words": f"{other} to {reference}",
                    "text": text if text == UNKNOWN else f"{text} µm/m",
                    "value": drawn(figure.value, MICRO) if figure else None,
                }
            )
        return {"figures": shown, "method": short_title(result.method) if result else ""}


class VerdictSection(Section):
    """The gap between run and model, and what the diagnosis makes of it."""

    name: ClassVar[str] = "verdict"

    def begin(self, run: RunBegin | None) -> None:
        """Know no diagnosis."""
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
            return {"verdict": None, "sentence": "no line has been compared with the model yet"}
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
        number = plus_minus(size.value, size.standard_uncertainty, MICRO if scaled else 1.0)
        sizes.append(f"{size.meaning}: {number} {'µ' if scaled else ''}{size.unit}".rstrip())
    return {"label": effect.label, "sentence": effect.sentence, "sizes": sizes}


class FaultSection(Section):
    """What is wrong, in the words of whoever says so; what is well is not listed."""

    name: ClassVar[str] = "faults"
    of_run = False

    def begin(self, run: RunBegin | None) -> None:
        """Know of no fault."""
        del run
        self._said: dict[str, Said] = {}
        self._silent: tuple[tuple[str, str], ...] = ()
        self._run = ""
        self._machine = ""

    def take(self, item: object) -> bool:
        """Take what nodes, the run and the machine complain of."""
        if isinstance(item, Said):
            before = self._said.get(item.name)
            if item.level == Level.OK:
                return self._said.pop(item.name, None) is not None
            self._said[item.name] = item
            return item != before
        if isinstance(item, Silent):
            changed, self._silent = item.nodes != self._silent, item.nodes
            # What a node said before it fell silent holds no more.
            gone = {name.lstrip("/") for name, _ in item.nodes}
            for name in [one for one in self._said if one.partition(": ")[0] in gone]:
                del self._said[name]
            return changed
        if isinstance(item, RunStatus):
            text = item.text if item.state is State.FAULT else ""
            changed, self._run = text != self._run, text
            return changed
        if isinstance(item, MachineStatus):
            text = (item.reason or "the machine is stopped") if item.troubled else ""
            changed, self._machine = text != self._machine, text
            return changed
        return False

    def document(self) -> dict[str, Any]:
        """Return faults first, then warnings."""
        found = []
        if self._run:
            found.append({"level": "fault", "who": "run", "text": self._run})
        if self._machine:
            found.append({"level": "fault", "who": "machine", "text": self._machine})
        found += [{"level": "fault", "who": "nodes", "text": text} for _, text in self._silent]
        worst_first = sorted(self._said.values(), key=lambda said: said.level != Level.ERROR)
        for said in worst_first:
            level = "fault" if said.level == Level.ERROR else "warning"
            node, _, task = said.name.rpartition(": ")
            who = node if task == HEARTBEAT else said.name
            found.append({"level": level, "who": who, "text": said.message})
        return {"faults": found[:_MOST_FAULTS], "more": max(0, len(found) - _MOST_FAULTS)}
