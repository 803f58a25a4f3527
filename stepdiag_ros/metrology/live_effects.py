"""The effects of a cell in a run that goes on: what they add to the reading of the present stop.

An effect depends on all stops of a run at once: history, sense of moves, time, weather, setup,
repeat. While a run is made, its later stops are not known; they are taken as the plan has them, so
that ``Effect.change`` sees a whole run at any time, and only its row for the present stop counts.
That row depends on what has been, so it is the one that the finished run will have.
"""

from dataclasses import replace

import numpy as np

from stepdiag_ros.metrology.cell import SimulatedCell
from stepdiag_ros.metrology.effects.effect import fault_named
from stepdiag_ros.metrology.effects.learned_shape import outside
from stepdiag_ros.metrology.effects.stops import Stops, stops_of
from stepdiag_ros.metrology.measurement import Environment
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.metrology.refusal import Refusal, fields_of
from stepdiag_ros.metrology.simulation import planned_run, read_again


def check_measurable(plan: Plan, cell: SimulatedCell) -> tuple[str, ...]:
    """Refuse a plan that cannot be measured on a simulated cell, before anything moves.

    Returns:
        sentences about learned effects that the plan takes outside their domains.

    Raises:
        ValueError: a stop is where the cell's errors are not given, or an effect cannot act.
    """
    cell.require_stops(plan)
    return LiveEffects(plan, cell).outside if cell.effects else ()


class LiveEffects:
    """What the effects of a simulated cell add to the readings of one run, stop by stop.

    Args:
        plan: of the run.
        cell: the true errors.

    Attributes:
        outside: sentences about learned effects that the plan takes outside their domains.

    Raises:
        ValueError: an effect cannot act in this plan; says which and why.
    """

    def __init__(self, plan: Plan, cell: SimulatedCell) -> None:
        if plan.tracker is not None:
            raise Refusal(
                f"the effects of the cell '{cell.name}' act on a beam that stands still, and plan"
                f" '{plan.name}' is measured with a tracker; take a cell without 'effects'",
                fault="unsupported",
            )
        self._effects = cell.effects
        self._bare = replace(cell, effects=())
        self._run = read_again(planned_run(plan, cell), self._bare)
        self._stops = stops_of(self._run)
        self._first = np.cumsum([0, *(len(line.time) for line in self._run.lines)])
        self._time = self._stops.time.copy()
        self._environment = np.concatenate([line.environment for line in self._run.lines])
        self._identity = {line.setup: line.setup for line in self._run.lines}
        for active in self._effects:
            with fault_named(active.effect):
                try:
                    active.readings(self._stops)
                except Refusal as error:
                    label = active.effect.label(active.setting)
                    raise Refusal(
                        f"the cell '{cell.name}' has the effect '{label}', which cannot act in the"
                        f" plan '{plan.name}': {error}",
                        **fields_of(error),
                    ) from None
        self.outside = outside(self._effects, self._stops)

    def at(
        self,
        line_index: int,
        stop: int,
        setup: str,
        time: float,
        environment: Environment,
        remember: bool = True,
    ) -> float:
        """Return what all effects together add to the reading at a stop, m.

        Args:
            line_index: of the plan, from 0.
            stop: of the line, from 0.
            setup: identity of the alignment; another one than before says that the setup was
                aligned again, so that what has been no longer counts in it.
            time: of the reading, s since the start of the run.
            environment: true air and material at that time.
            remember: later stops see this time and this environment as those of the stop.
        """
        self._notice(setup, line_index)
        row = int(self._first[line_index]) + stop
        before = self._time.copy(), self._environment[row].copy()
        # Stops to come are as far behind this one as the plan has them.
        self._time[row + 1 :] += time - self._time[row]
        self._time[row] = time
        self._environment[row] = environment
        stops = self._present()
        total = float(sum(active.readings(stops)[row] for active in self._effects))
        if not remember:
            self._time, self._environment[row] = before
        return total

    def _present(self) -> Stops:
        air, pressure, humidity, material = self._environment.T
        return replace(
            self._stops,
            time=self._time,
            air_temperature=air,
            air_pressure=pressure,
            relative_humidity=humidity,
            material_temperature=material,
        )

    def _notice(self, identity: str, line_index: int) -> None:
        """Begin a setup again if it was aligned again: a new zero, and no move made in it yet."""
        name = self._run.lines[line_index].setup
        last, self._identity[name] = self._identity[name], identity
        if identity == last:
            return
        # The present alignment keeps the plan's name, by which the setting of an effect knows it.
        lines = tuple(
            replace(line, setup=f"{last}, left") if earlier and line.setup == name else line
            for line, earlier in (
                (line, index < line_index) for index, line in enumerate(self._run.lines)
            )
        )
        self._run = read_again(replace(self._run, lines=lines), self._bare)
        self._stops = stops_of(self._run)
