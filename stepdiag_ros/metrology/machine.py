"""What is known of the real machine: its chain, its travel and what its drives may do."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from stepdiag_ros.metrology.checking import Section
from stepdiag_ros.metrology.geometry import AXES, CHAINS
from stepdiag_ros.metrology.plausible import CLASSES, DEFAULT_CLASS, ROTATIONS_KEY, size_of
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.units import IN_MILLI

LONGEST_TRAVEL = 100.0
"""From there on a limit of travel is in millimetres, m; the longest gantries have 60 m."""


@dataclass(frozen=True)
class Machine:
    """A three-axis machine as its builder describes it.

    Attributes:
        name: in words.
        chain: order of the axes from workpiece to tool, one of ``geometry.CHAINS``, for example YXZ
            (Ibaraki & Hata 2010, Fig. 4).
        travel_low_m: lower soft limits of X, Y, Z, machine coordinates, m.
        travel_high_m: upper soft limits of X, Y, Z, m, each above the lower one.
        feed_limit_m_per_s: largest feed of an axis, m/s.
        acceleration_m_per_s2: of an axis, m/s².
        rotations: plausible size of its angular errors over the measured travel, rad; see
            ``plausible``.
        rotations_stated: the machine file states that size; if not, it is assumed.
        position_window_m: an axis is in position while it is within this distance of its target, m.
        position_hold_s: ... and has been so for this time, s.
        zero_drift_m_per_s: rate at which the zero of the readings drifts within a pass, m/s.
        growth_per_s: rate at which the axes grow as they warm up, relative, 1/s.
    """

    name: str
    chain: str
    travel_low_m: tuple[float, float, float]
    travel_high_m: tuple[float, float, float]
    feed_limit_m_per_s: float
    acceleration_m_per_s2: float
    position_window_m: float = 0.5e-6
    position_hold_s: float = 0.02
    rotations: float = CLASSES[DEFAULT_CLASS]
    rotations_stated: bool = False
    zero_drift_m_per_s: float = 1e-10
    growth_per_s: float = 5e-10

    @classmethod
    def from_mapping(cls, mapping: Mapping[str, Any], source: str) -> "Machine":
        """Make a machine from the parsed YAML of a machine file (layout in ``config/machines``).

        Args:
            mapping: the parsed file; its keys are the attributes.
            source: what the user calls the file, for the text of an error.

        Raises:
            ValueError: names the source, the key, what is wrong and what is expected.
        """
        section = Section(mapping, source)
        section.require(
            (
                "chain",
                "travel_low_m",
                "travel_high_m",
                "feed_limit_m_per_s",
                "acceleration_m_per_s2",
            )
        )
        rotations = told_rotations(section)
        machine = cls(
            name=section.text("name", default="unnamed"),
            chain=section.names("chain", CHAINS)[0],
            travel_low_m=_travel(section, "travel_low_m"),
            travel_high_m=_travel(section, "travel_high_m"),
            feed_limit_m_per_s=section.feed("feed_limit_m_per_s"),
            acceleration_m_per_s2=section.number("acceleration_m_per_s2", low=1e-6, high=1e3),
            position_window_m=section.number(
                "position_window_m", low=1e-9, high=1e-2, default=cls.position_window_m
            ),
            position_hold_s=section.number(
                "position_hold_s", low=0.0, high=60.0, default=cls.position_hold_s
            ),
            rotations=CLASSES[DEFAULT_CLASS] if rotations is None else rotations,
            rotations_stated=rotations is not None,
            zero_drift_m_per_s=section.number(
                "zero_drift_m_per_s", low=0.0, high=1e-6, default=cls.zero_drift_m_per_s
            ),
            growth_per_s=section.number(
                "growth_per_s", low=0.0, high=1e-6, default=cls.growth_per_s
            ),
        )
        section.finish()
        for axis, low, high in zip(AXES, machine.travel_low_m, machine.travel_high_m, strict=True):
            if low >= high:
                raise Refusal(
                    f"{source}: travel_low_m of {axis} is {low:g},"
                    f" not below travel_high_m {high:g}",
                    fault="mismatch",
                    aspect="travel",
                )
        return machine


def _travel(section: Section, key: str) -> tuple[float, float, float]:
    limits = section.vector(key, low=-1e6, high=1e6)
    farthest = max(limits, key=abs)
    if abs(farthest) >= LONGEST_TRAVEL:
        meant = ", ".join(f"{limit / IN_MILLI:g}" for limit in limits)
        raise Refusal(
            f"{section.source}: {key} is {farthest:g} m, and lengths are in metres."
            f" Did you mean [{meant}]?",
            fault="out_of_range",
            about=key,
            where=section.source,
        )
    return limits


def told_rotations(section: Section) -> float | None:
    """Return the plausible size of rotations that a file's section states, rad; None without one.

    Raises:
        ValueError: it is neither a class of machine nor a size.
    """
    told = section.given([ROTATIONS_KEY])
    try:
        return size_of(told[ROTATIONS_KEY]) if told else None
    except ValueError as wrong:
        raise ValueError(f"{section.source}: '{ROTATIONS_KEY}': {wrong}") from None
