"""Sections about what is measured: the beam, the last stop, the blocks, the air."""

import math
from collections import deque
from typing import Any, ClassVar

import numpy as np

from stepdiag_ros import topics
from stepdiag_ros.devices.interferometer import STATUS_LOW_SIGNAL, STATUS_OK
from stepdiag_ros.evaluation.report import short_title
from stepdiag_ros.metrology.air.recompensation import SensorValue
from stepdiag_ros.metrology.measurement import BlockDisplacement, Reading, SettledStop
from stepdiag_ros.metrology.plan import FORWARD, Line
from stepdiag_ros.metrology.solvers.result import VolumetricErrors
from stepdiag_ros.metrology.tracker.tracked_line import TRACKER
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR
from stepdiag_ros.metrology.units import IN_MICRO, IN_MILLI
from stepdiag_ros.run.device_health import DIM, GOOD, NO_READING_YET, NOW_LOST
from stepdiag_ros.text.numbers import UNKNOWN
from stepdiag_ros.viewers.page.contact import QUIET_AFTER, Contact
from stepdiag_ros.viewers.page.expectation import expected_displacement, nominal_displacement
from stepdiag_ros.viewers.page.items import RunBegin
from stepdiag_ros.viewers.page.section import PageSection, drawn, measured, micrometres
from stepdiag_ros.viewers.scene.error_markers import chosen_results

_ROUGH = (
    "The tracker's place is known roughly until its readings are evaluated, and so is the nominal"
    " length."
)
_KEPT_STOPS = 120
"""Stops of which the page draws how far they are from what was expected."""
_KEPT_BLOCKS = 400
"""Blocks of a pass that are drawn; of a longer one the last."""
_TENTH = 10
"""Resolution of the signal as parts of a percent: noise is not news."""


class BeamSection(PageSection):
    """Whether there is a beam, how strong it is, and what it reads."""

    name: ClassVar[str] = "beam"
    of_run = False

    def begin(self, run: RunBegin | None) -> None:
        """Start empty."""
        del run
        self._reading: Reading | None = None
        self._silence = ""

    def take(self, item: object) -> bool:
        """Take the newest reading, and whether readings still come."""
        if isinstance(item, Contact):
            before, self._silence = self._silence, _silence(item)
            return self._silence != before
        if not isinstance(item, Reading):
            return False
        self._reading = item
        return True

    def document(self) -> dict[str, Any]:
        """Return strength, state and reading."""
        reading = self._reading
        if reading is None or self._silence:
            why = f"not known: {self._silence}" if self._silence else NO_READING_YET
            return {"state": None, "words": why, "strength": None, "percent": UNKNOWN}
        strength = reading.signal_strength
        words = {STATUS_OK: GOOD, STATUS_LOW_SIGNAL: DIM} | NOW_LOST
        states = {STATUS_OK: "good", STATUS_LOW_SIGNAL: "dim"}
        return {
            "state": states.get(reading.status, "lost"),
            "words": words.get(reading.status, f"the beam has the unknown status {reading.status}"),
            "strength": (
                round(strength * 100 * _TENTH) / (100 * _TENTH) if math.isfinite(strength) else None
            ),
            "percent": measured(strength, "%", 0, 100.0),
            "reading": measured(reading.compensated_displacement, "mm", 5, IN_MILLI),
            "sequence": reading.sequence,
        }


def _silence(contact: Contact) -> str:
    if contact.misses("interferometer"):
        return "the interferometer is silent"
    if topics.READING.name in contact.quiet:
        return f"no reading has come for {QUIET_AFTER:g} s"
    return ""


class StopSection(PageSection):
    """The last stop: what was measured against a perfect machine and against the model.

    Both are counted from the first settled stop of the setup, at which the reading is zeroed. If
    that stop is missing, how far a stop is from it is not known. A tracker's place is known only
    roughly until its readings are evaluated, so neither a perfect machine's reading nor the model's
    is known to better than millimetres: how far a stop is off is then unknown.
    """

    name: ClassVar[str] = "stop"

    def begin(self, run: RunBegin | None) -> None:
        """Take up a run."""
        self._run = run
        self._results: dict[str, VolumetricErrors] = {}
        # Setup → its first settled stop, where that was heard.
        self._first: dict[str, SettledStop] = {}
        self._heard_from_the_start: dict[str, bool] = {}
        self._last: dict[str, Any] = {}
        self._trace: deque[list[float | None]] = deque(maxlen=_KEPT_STOPS)
        self._number = 0

    def take(self, item: object) -> bool:
        """Take stops, and the results that predict the next."""
        if isinstance(item, VolumetricErrors):
            self._results[item.method] = item
            return False
        if not isinstance(item, SettledStop) or self._run is None:
            return False
        self._number += 1
        self._last = self._shown(item)
        return True

    def document(self) -> dict[str, Any]:
        """Return the last stop, and how far the last ones were from what was expected."""
        return {"last": self._last or None, "trace": list(self._trace)}

    def _shown(self, stop: SettledStop) -> dict[str, Any]:
        command = stop.command
        known = self._heard_from_the_start.setdefault(command.setup, self._begins_setup(stop))
        told = {
            "line": str(stop.line),
            "stop": command.stop,
            "settled": stop.settled,
            "reason": stop.reason,
            "readings": stop.readings,
        }
        if not stop.settled:
            self._trace.append([self._number, None, None])
            return told
        first = self._first.setdefault(command.setup, stop)
        displacement = nominal = expected = math.nan
        method = ""
        tracked = self._line(stop).tracked is not None
        if known:
            displacement = stop.displacement - first.displacement
            nominal, expected, method = self._expected(first, stop)
        from_nominal = math.nan if tracked else displacement - nominal
        from_expected = displacement - expected
        # The zero has an uncertainty of its own, and is not a stop against itself.
        uncertainty = math.hypot(stop.standard_uncertainty, first.standard_uncertainty)
        uncertainty = 0.0 if stop is first else COVERAGE_FACTOR * uncertainty
        self._trace.append(
            [self._number, drawn(from_nominal, IN_MICRO), drawn(from_expected, IN_MICRO)]
        )
        return told | {
            "zero_known": known,
            "note": _ROUGH if tracked else "",
            "displacement_m": displacement if known else None,
            "displacement": measured(displacement, "mm", 5, IN_MILLI),
            "nominal": measured(nominal, "mm", 5, IN_MILLI),
            "from_nominal": micrometres(from_nominal, uncertainty),
            "expected": measured(expected, "mm", 5, IN_MILLI),
            "from_expected": micrometres(from_expected, uncertainty),
            "expected_by": short_title(method) if method else "",
        }

    def _line(self, stop: SettledStop) -> Line:
        """Return a stop's line as the plan has it: messages lack a tracker's places."""
        assert self._run is not None
        lines = self._run.plan.lines
        index = stop.command.line_index
        return lines[index] if index < len(lines) else stop.line

    def _begins_setup(self, stop: SettledStop) -> bool:
        """Return whether a stop is the first of its setup, as far as the plan shows."""
        assert self._run is not None
        lines = enumerate(self._run.plan.lines)
        first = next((n for n, line in lines if line.setup == stop.command.setup), None)
        # A setup whose zero was lost goes on under a name that is not in the plan.
        return stop.command.stop == 0 and first in (None, stop.command.line_index)

    def _expected(self, first: SettledStop, stop: SettledStop) -> tuple[float, float, str]:
        assert self._run is not None
        volume = self._run.plan.volume
        start, end = np.array(first.command.target), np.array(stop.command.target)
        line = self._line(stop)
        nominal = nominal_displacement(line, volume, start, end)
        best_first = reversed(chosen_results(self._results, "all"))
        expected, method = expected_displacement(
            best_first, line, stop.command.setup, volume, self._run.chain, (start, end)
        )
        return nominal, expected, method


class BlockSection(PageSection):
    """The blocks of the present pass as they come, and of the pass before over the same line."""

    name: ClassVar[str] = "blocks"

    def begin(self, run: RunBegin | None) -> None:
        """Start without a block."""
        self._plan = run.plan if run else None
        self._key: tuple[int, int] | None = None
        self._line: Line | None = None
        self._last_stop = 0
        self._blocks: deque[BlockDisplacement] = deque(maxlen=_KEPT_BLOCKS)
        self._before: tuple[BlockDisplacement, ...] = ()
        self._count = 0

    def take(self, item: object) -> bool:
        """Take the next block."""
        if not isinstance(item, BlockDisplacement):
            return False
        key = (item.line_index, item.attempt)
        if key != self._key:
            # Refused here, if there is no such line, and not when the page is written.
            last_stop = self._last_of(item) if self._plan else 0
            # All lines of a tracker's station are of one setup.
            same = (item.line.setup, item.line.name)
            again = self._line is not None and (self._line.setup, self._line.name) == same
            self._before = tuple(self._blocks) if again else ()
            self._key, self._line, self._last_stop = key, item.line, last_stop
            self._blocks.clear()
        self._blocks.append(item)
        self._count += 1
        return True

    def _last_of(self, block: BlockDisplacement) -> int:
        """Return the number of the last stop of a block's line; a tracker's only the plan has."""
        assert self._plan is not None
        tracked = self._plan.tracker is not None and block.line_index < len(self._plan.lines)
        line = self._plan.lines[block.line_index] if tracked else block.line
        return len(line.stops(self._plan.volume)) - 1

    def document(self) -> dict[str, Any]:
        """Return displacement less nominal of each, in µm, with U (95 %), counted forward."""
        last = self._blocks[-1] if self._blocks else None
        return {
            "line": str(self._line) if self._line else "",
            "count": self._count,
            "blocks": [self._shown(block) for block in self._blocks],
            "before": [self._shown(block) for block in self._before],
            "last": None
            if last is None
            else {
                "block": last.block,
                "axis": last.axis,
                "displacement_m": last.line.sense * last.displacement,
                "displacement": measured(last.line.sense * last.displacement, "mm", 5, IN_MILLI),
                "deviation": micrometres(
                    _deviation(last), COVERAGE_FACTOR * last.standard_uncertainty
                ),
            },
        }

    def _shown(self, block: BlockDisplacement) -> list[Any]:
        """Return place, axis, deviation and u; counted forward, so that passes can be compared."""
        place = (block.from_stop + block.to_stop) / 2.0
        if block.line.direction != FORWARD:
            place = self._last_stop - place
        return [
            place,
            block.axis,
            drawn(_deviation(block), IN_MICRO),
            drawn(block.standard_uncertainty, IN_MICRO),
        ]


def _deviation(block: BlockDisplacement) -> float:
    if block.line.kind == TRACKER:
        return math.nan  # its nominal displacement is from a rough place of the tracker
    return block.line.sense * (block.displacement - block.nominal_displacement)


class WeatherSection(PageSection):
    """The air and the machine's temperature, by the sensors or by the values given to the laser."""

    name: ClassVar[str] = "weather"
    of_run = False
    SHOWN: ClassVar[dict[str, tuple[str, str, int, float]]] = {
        "air_temperature": ("air", "°C", 2, 1.0),
        "air_pressure": ("pressure", "hPa", 2, 0.01),
        "relative_humidity": ("humidity", "%", 1, 100.0),
        "material_temperature": ("machine", "°C", 2, 1.0),
    }

    def begin(self, run: RunBegin | None) -> None:
        """Start empty."""
        del run
        self._values: dict[str, float] = {}
        self._sensed: set[str] = set()

    def take(self, item: object) -> bool:
        """Take what sensors say; what they do not, is taken from readings."""
        if isinstance(item, SensorValue):
            self._sensed.add(item.name)
            return self._set(item.name, item.value)
        if isinstance(item, Reading):
            told = item.environment._asdict().items()
            return sum(self._set(k, v) for k, v in told if k not in self._sensed) > 0
        return False

    def document(self) -> dict[str, Any]:
        """Return each quantity with its unit."""
        return {
            "values": [
                {
                    "name": words,
                    "text": measured(self._values.get(name, math.nan), unit, decimals, scale),
                    "source": "sensor" if name in self._sensed else "as compensated",
                }
                for name, (words, unit, decimals, scale) in self.SHOWN.items()
            ]
        }

    def _set(self, name: str, value: float) -> bool:
        before = self._values.get(name, math.nan)
        self._values[name] = value
        _, unit, decimals, scale = self.SHOWN[name]
        return measured(before, unit, decimals, scale) != measured(value, unit, decimals, scale)
