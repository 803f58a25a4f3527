"""Sequence of a run as a simulated interferometer follows it: what effects add to each reading.

An effect is defined at stops. At a stop each window of readings that the assembler may average has
the change that the effect makes at the mean time of its readings, so that the settled stop shows
what the effect says, whichever window is taken. On the way from one stop to the next the change
goes over in proportion to the way that the axes have really made.
"""

from bisect import bisect_right
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from stepdiag_ros.devices.grid import SampleGrid
from stepdiag_ros.devices.interferometer import Point
from stepdiag_ros.metrology.cell import SimulatedCell
from stepdiag_ros.metrology.geometry import Vector, inner
from stepdiag_ros.metrology.live_effects import LiveEffects
from stepdiag_ros.metrology.measurement import StopCommand
from stepdiag_ros.metrology.plan import Plan

_NEVER = 2**63 - 1
_NEAR = 1e-3
"""m: farther than this from a place, no controller says that it is in position there."""
_PATIENCE = 500_000_000
"""ns: so long the next command is waited for after the readings of a stop are complete."""


@dataclass
class _Leg:
    """One commanded move, and the stay at its end.

    Attributes:
        command: what is asked; a positioning move leads towards stop 0 of its line.
        ends_at_stop: the interferometer is read at its end.
        begin: place of the axes when the move began, m; None before that.
        before: what the effects added then, m.
        coming: what they add at the end, as far as it can be foreseen, m.
        arrival: when the axes were in position, ns; None before that.
        open: the controller's last word on the move has not come.
        windows: number of a window of readings → what the effects add in it, m.
    """

    command: StopCommand
    ends_at_stop: bool
    begin: Vector | None = None
    before: float = 0.0
    coming: float = 0.0
    arrival: int | None = None
    open: bool = True
    windows: dict[int, float] = field(default_factory=dict)


class FollowedCourse:
    """Follows a run by its commands, the controller's answers and the positions.

    Args:
        plan: of the run.
        cell: the true errors.
        start: of the run, ns.
        weather_begins: the zero of the cell's weather, ns.
        grid: of the readings.

    Raises:
        ValueError: an effect of the cell cannot act in this plan.
    """

    def __init__(
        self, plan: Plan, cell: SimulatedCell, start: int, weather_begins: int, grid: SampleGrid
    ) -> None:
        self._plan = plan
        self._cell = cell
        self._effects = LiveEffects(plan, cell)
        self._start = start
        self._weather_begins = weather_begins
        self._grid = grid
        self._settle = round(plan.sampling.settle * 1e9)
        self._window = round(plan.sampling.window * 1e9)
        # The leg of the present reading, and those that have been commanded beyond it.
        self._leg: _Leg | None = None
        self._later: deque[_Leg] = deque()
        # Answers to commands that have not come yet.
        self._early: dict[int, tuple[int, bool]] = {}
        self._place: Vector | None = None
        self._added = 0.0
        self._certain = -_NEVER

    def command(self, command: StopCommand, ends_at_stop: bool) -> None:
        """Take the next command; one that was taken before is left out."""
        last = self._last
        if last is not None and command.command_id <= last.command.command_id:
            return
        if last is not None:
            last.open = False
        self._later.append(_Leg(command, ends_at_stop))
        if command.command_id in self._early:
            self.answer(command.command_id, *self._early.pop(command.command_id))

    def answer(self, command_id: int, time: int, in_position: bool) -> None:
        """Take the controller's last word on a command: in position at a time (ns), or not.

        It may overtake the command, above all where the machine stands at its target already.
        """
        legs = [leg for leg in (self._leg, *self._later) if leg is not None]
        if not legs or command_id > legs[-1].command.command_id:
            self._early[command_id] = time, in_position
        for leg in legs:
            if leg.command.command_id == command_id:
                leg.arrival = time if in_position else None
                leg.open = False

    def interrupt(self) -> None:
        """Expect no more of the present move: the beam is set up again, the machine stands."""
        if self._last is not None:
            self._last.open = False

    def certain_until(self, now: int, times: Sequence[int], positions: Sequence[Point]) -> int:
        """Return the time (ns) up to which positions, commands and answers are surely known.

        Messages of different topics may overtake each other: a machine that stands where it is to
        go may have been in position for some time, one that is elsewhere must have been sent there,
        and one whose stop has been read may stay for the next pass.

        Args:
            now: ns.
            times: of the known positions, ns.
            positions: m, one a time.
        """
        limit = self._expected_until(now)
        index = bisect_right(times, self._certain)
        while index < len(times) and self._is_certain(times[index], positions[index]):
            if times[index] > limit:
                # Between two positions the machine is where both have it.
                return max(limit, self._certain)
            self._certain = times[index]
            index += 1
        return self._certain

    def _expected_until(self, now: int) -> int:
        """Return the time (ns) beyond which the next command may already have been given."""
        last = self._last
        if last is not None and last.open:
            return _NEVER
        complete = -_NEVER
        if last is not None and last.arrival is not None:
            complete = last.arrival
            if last.ends_at_stop:
                # Before the reading that ends the window, nobody asks for the next stop.
                complete = self._grid.first(last.arrival + self._settle + self._window)
        return max(complete, now - _PATIENCE)

    def added(self, times: NDArray[np.int64], positions: Vector) -> Vector:
        """Return what the effects add to some readings, m, shape (n,); in order of time.

        Args:
            times: of the readings, ns, shape (n,).
            positions: actual ones at these times, m, shape (n, 3).
        """
        result = np.empty(len(times))
        index = 0
        while index < len(times):
            self._go_on(int(times[index]))
            next_leg = self._later[0].command.time if self._later else _NEVER
            end = int(np.searchsorted(times, next_leg))
            part = slice(index, end)
            result[part] = self._on_leg(times[part], positions[part])
            self._place, self._added = positions[end - 1], float(result[end - 1])
            index = end
        return result

    @property
    def _last(self) -> _Leg | None:
        return self._later[-1] if self._later else self._leg

    def _is_certain(self, time: int, position: Point) -> bool:
        later = [leg for leg in self._later if leg.command.time <= time]
        leg = later[-1] if later else self._leg
        if leg is None:
            return True
        near = float(np.linalg.norm(np.subtract(position, leg.command.target))) <= _NEAR
        if leg.open:
            return not near
        return leg.arrival is None or time <= leg.arrival or near or leg is not self._last

    def _go_on(self, time: int) -> None:
        """Come to the leg to which a reading at this time (ns) belongs."""
        while self._later and self._later[0].command.time <= time:
            leg = self._leg = self._later.popleft()
            leg.begin, leg.before = self._place, self._added
            if leg.begin is None:
                leg.begin = np.asarray(leg.command.target)
            way = float(np.linalg.norm(np.asarray(leg.command.target) - leg.begin))
            travel = round(way / self._plan.feed * 1e9)
            window = leg.command.time + travel + self._settle
            leg.coming = self._at_stop(leg, window)

    def _on_leg(self, times: NDArray[np.int64], positions: Vector) -> Vector:
        leg = self._leg
        if leg is None or leg.begin is None:
            return np.zeros(len(times))
        way = np.asarray(leg.command.target) - leg.begin
        length = float(inner(way, way))
        share = inner(positions - leg.begin, way) / length if length else np.ones(len(times))
        values = leg.before + np.clip(share, 0.0, 1.0) * (leg.coming - leg.before)
        if leg.arrival is not None:
            stands = times >= leg.arrival
            if not leg.ends_at_stop:
                return np.where(stands, leg.coming, values)
            numbers = np.maximum(times - leg.arrival - self._settle, 0) // self._window
            for number in np.unique(numbers[stands]).tolist():
                values[stands & (numbers == number)] = self._in_window(leg, leg.arrival, number)
        return values

    def _in_window(self, leg: _Leg, arrival: int, number: int) -> float:
        if number not in leg.windows:
            begin = arrival + self._settle + number * self._window
            # A stop that does not settle in its first window is rare, and its delay short.
            leg.windows[number] = self._at_stop(leg, begin, remember=number == 0)
        return leg.windows[number]

    def _at_stop(self, leg: _Leg, begin: int, remember: bool = True) -> float:
        """Return what the effects add to the readings of the window that begins at a time (ns)."""
        instants = self._grid.within(begin, begin + self._window)
        time = sum(instants) // len(instants) if instants else begin + self._window // 2
        return self._effects.at(
            leg.command.line_index,
            leg.command.stop,
            leg.command.setup,
            (time - self._start) * 1e-9,
            self._cell.environment((time - self._weather_begins) * 1e-9),
            remember,
        )
