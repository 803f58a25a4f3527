"""Small runs made by hand for the assembler's tests: exact commands, arrivals and readings."""

from dataclasses import dataclass, field

import numpy as np

from stepdiag_ros.metrology.assembly import Event
from stepdiag_ros.metrology.geometry import beam_direction
from stepdiag_ros.metrology.measurement import (
    Arrival,
    BlockDisplacement,
    Environment,
    MeasuredLine,
    Reading,
    SettledStop,
    StopCommand,
)
from stepdiag_ros.metrology.plan import (
    BACKWARD,
    FORWARD,
    LINEAR,
    STEP_DIAGONAL,
    Line,
    Plan,
    Sampling,
    Volume,
    moved_axes,
)

START = 1_700_000_000_123_456_789
SECOND = 1_000_000_000
AIR = Environment(20.0, 101325.0, 0.5, 20.5)
SAMPLING = Sampling(
    dwell=0.4,
    settle=0.1,
    window=0.2,
    longest_wait=0.9,
    standard_deviation_limit=1e-6,
    drift_limit=0.5e-6,
)
VOLUME = Volume((0.0, 0.0, 0.0), (0.01, 0.01, 0.01), 1)
FORTH = Line(STEP_DIAGONAL, "npp", "XYZ", 0, FORWARD)
BACK = Line(STEP_DIAGONAL, "npp", "XYZ", 0, BACKWARD)
LINEAR_X = Line(LINEAR, "x", "", 0, FORWARD)
PLAN = Plan("two lines", VOLUME, (FORTH, BACK), 0.1, SAMPLING)


@dataclass
class Run:
    """The three streams of a run in which each move takes 0.3 s and each stop lasts 1 s."""

    plan: Plan = PLAN
    rate: float = 100.0
    noise: float = 50e-9
    seed: int = 1
    commands: list[StopCommand] = field(default_factory=list)
    arrivals: list[Arrival] = field(default_factory=list)
    readings: list[Reading] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.now = START
        self.random = np.random.default_rng(self.seed)
        self.count = 0
        self.position = np.zeros(3)

    def measure(
        self, line_index: int = 0, attempt: int = 1, setup: str = "", stops: int | None = None
    ) -> None:
        """Add a pass along a line, or its first stops."""
        line = self.plan.lines[line_index]
        targets = line.stops(self.plan.volume)[:stops]
        for number, target in enumerate(targets):
            before = targets[number - 1] if number else target
            self.commands.append(
                StopCommand(
                    command_id=10 * (len(self.commands) + 1),
                    line_index=line_index,
                    attempt=attempt,
                    setup=setup or line.setup,
                    stop=number,
                    axis=moved_axes(before, target),
                    target=tuple(target.tolist()),
                    time=self.now,
                )
            )
            self.read(0.3, target, line)
            self.arrivals.append(
                Arrival(self.commands[-1].command_id, self.now, tuple((target + 1e-7).tolist()))
            )
            self.read(1.0, target, line)

    def read(self, seconds: float, target: np.ndarray, line: Line) -> None:
        """Add the readings of some time on the way to a position and at it."""
        beam = beam_direction(line.name, np.asarray(self.plan.volume.step))
        begin = self.position
        end = self.now + round(seconds * SECOND)
        while (time := START + round(self.count * SECOND / self.rate)) < end:
            way = min((time - self.now) / (0.3 * SECOND), 1.0)
            value = 0.123 + float(beam @ (begin + way * (target - begin)))
            value += self.noise * float(self.random.standard_normal())
            self.readings.append(Reading(time, self.count, 1.00027 * value, value, 1.0, 0, AIR))
            self.count += 1
        self.position = np.asarray(target)
        self.now = end

    def change(self, begin: int, end: int, **fields: object) -> None:
        """Replace fields of the readings within [begin, end) ns."""
        self.readings = [
            reading._replace(**fields) if begin <= reading.time < end else reading
            for reading in self.readings
        ]

    def shift(self, begin: int, end: int, change: object) -> None:
        """Add ``change(seconds since begin)`` to the displacement in [begin, end)."""
        self.readings = [
            reading._replace(
                compensated_displacement=reading.compensated_displacement
                + change((reading.time - begin) * 1e-9)  # type: ignore[operator]
            )
            if begin <= reading.time < end
            else reading
            for reading in self.readings
        ]


def stops_of(events: list[Event]) -> list[SettledStop]:
    """Return the settled and rejected stops among events."""
    return [event for event in events if isinstance(event, SettledStop)]


def blocks_of(events: list[Event]) -> list[BlockDisplacement]:
    """Return the block displacements among events."""
    return [event for event in events if isinstance(event, BlockDisplacement)]


def lines_of(events: list[Event]) -> list[MeasuredLine]:
    """Return the finished lines among events."""
    return [event for event in events if isinstance(event, MeasuredLine)]
