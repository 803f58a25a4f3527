"""What a bag cannot know, as its user gives it."""

from dataclasses import dataclass, field
from math import nan
from typing import TYPE_CHECKING

from stepdiag_ros.metrology.standards.positioning_uncertainty import UncertaintyDescription
from stepdiag_ros.metrology.uncertainty.instrument import Instrument

if TYPE_CHECKING:
    from stepdiag_ros.archive.histories import HistoryOfRun
    from stepdiag_ros.evaluation.recorded_run import Correct


@dataclass(frozen=True)
class Given:
    """What a bag cannot know; empty or NaN where it was not given.

    Attributes:
        customer: for whom it was measured.
        operator: who measured.
        place: where.
        serial: number of the machine.
        remark: further words.
        tolerance: longest error vector in the volume that is allowed, m; NaN: none is known.
        instrument: what is known of laser, sensors, material and setup.
        laser_serial: number of the laser.
        laser_certificate: number of its calibration certificate.
        instrument_source: name of that description; empty: none was given.
        conditions: what is known of the conditions of the ISO 230 tests.
        control: that compensation is shown for.
        history: of the machine, by an archive; None if none was named.
        correct: returns lines at 20 °C, and in words how; None: results hold at the temperature
            that the machine had.
        expansion: coefficient that ``correct`` corrects with, 1/K; NaN without one.
        material_temperature: of the machine that it corrects from, °C; None: as recorded.
    """

    customer: str = ""
    operator: str = ""
    place: str = ""
    serial: str = ""
    remark: str = ""
    tolerance: float = nan
    instrument: Instrument = field(default_factory=Instrument)
    instrument_source: str = ""
    laser_serial: str = ""
    laser_certificate: str = ""
    conditions: UncertaintyDescription = field(default_factory=UncertaintyDescription)
    control: str = "generic"
    history: "HistoryOfRun | None" = None
    correct: "Correct | None" = None
    expansion: float = nan
    material_temperature: float | None = None
