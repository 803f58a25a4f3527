"""How a simulated interferometer behaves: its rate, its noise, its clock and its limits."""

from dataclasses import dataclass

from stepdiag_ros.metrology.air import DEFAULT_EQUATION, EQUATIONS
from stepdiag_ros.metrology.cell import SimulatedCell
from stepdiag_ros.metrology.checking import Section


@dataclass(frozen=True)
class Behaviour:
    """How the simulated instrument behaves.

    Attributes:
        rate: of the readings, Hz.
        seed: of the noise.
        hold_after: without positions for this time the last one is taken to hold, s.
        weather_age: sensor values older than this are no longer used, s.
        believed_dead_path: that the compensation calculates with, m.
        fastest: speed that the counter can follow, m/s.
        weather_begins: the zero of the cell's weather, ns.
        index_equation: that the compensation takes, one of ``air.EQUATIONS``.
        transport_delay: of the readings, which are stamped when they come in, s.
        clock_offset: by which the instrument's clock is ahead of the computer's at first, s.
        clock_drift: by which it gains on the computer's, s/s.
    """

    rate: float
    seed: int
    hold_after: float
    weather_age: float
    believed_dead_path: float
    fastest: float
    weather_begins: int
    index_equation: str
    transport_delay: float = 0.0
    clock_offset: float = 0.0
    clock_drift: float = 0.0

    @classmethod
    def from_section(cls, section: Section, cell: SimulatedCell) -> "Behaviour":
        """Take the settings that ``simulated.from_settings`` lists.

        Raises:
            ValueError: a setting is wrong.
        """
        return cls(
            rate=section.number("rate_hz", low=0.1, high=1e5, default=cell.reading_rate),
            seed=section.integer("seed", low=0, high=2**63 - 1, default=0),
            hold_after=section.number("hold_after_s", low=0.0, high=3600.0, default=0.2),
            weather_age=section.number("weather_age_s", low=0.1, high=86400.0, default=10.0),
            believed_dead_path=section.number(
                "dead_path_m", low=0.0, high=100.0, default=cell.dead_path
            ),
            fastest=section.number("fastest_m_per_s", low=1e-3, high=1e3, default=4.0),
            weather_begins=section.integer("weather_begins_ns", low=0, high=2**63 - 1, default=0),
            index_equation=section.names(
                "index_equation", tuple(EQUATIONS), default=(DEFAULT_EQUATION,)
            )[0],
            transport_delay=section.number("transport_delay_s", low=0.0, high=10.0, default=0.0),
            clock_offset=section.number("clock_offset_s", low=-10.0, high=10.0, default=0.0),
            clock_drift=section.number("clock_drift", low=-1e-2, high=1e-2, default=0.0),
        )
