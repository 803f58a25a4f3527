"""A tracker, its places and its passes in words, for the part of a page about the measurement."""

from collections import Counter

import numpy as np

from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.metrology.tracker.instrument import Tracker
from stepdiag_ros.metrology.tracker.readings import GRID, LOCATE
from stepdiag_ros.metrology.tracker.tracked_line import Point, station_of, test_line_of
from stepdiag_ros.metrology.units import IN_MICRO, IN_MILLI
from stepdiag_ros.report.pages.page import Fact
from stepdiag_ros.text.numbers import plain

_PLACES = {LOCATE: "places that locate the tracker", GRID: "places of a grid"}


def stations_in(plan: Plan) -> dict[str, Point]:
    """Return the stations of a plan, in order: name → rough place of the tracker, m."""
    return {
        station_of(line.name): line.tracked.station
        for line in plan.lines
        if line.tracked is not None
    }


def tracker_facts(plan: Plan, tracker: Tracker) -> list[Fact]:
    """Return what a plan says of the instrument, of each of its places and of the passes there."""
    facts = [
        Fact(
            "Tracker",
            f"{tracker.name}, held by the {tracker.held_by}; lengths from"
            f" {tracker.minimum_range:g} m to {tracker.maximum_range:g} m, elevation"
            f" {np.degrees(tracker.lowest_elevation):.0f}° to"
            f" {np.degrees(tracker.highest_elevation):.0f}°",
        ),
        Fact(
            "u(length)",
            f"{tracker.length_noise * IN_MICRO:g} µm and"
            f" {tracker.length_proportional * IN_MICRO:g} µm/m of the length, as the plan says",
        ),
    ]
    for station, place in stations_in(plan).items():
        passes = Counter(
            test_line_of(line.name) for line in plan.lines if station_of(line.name) == station
        )
        where = ", ".join(plain(value * IN_MILLI, 1) for value in place)
        measured = "; ".join(
            _PLACES.get(name, f"line {name}, {count} passes") for name, count in passes.items()
        )
        facts.append(Fact(f"Station {station}", f"roughly at {where} mm (X, Y, Z): {measured}"))
    return facts
