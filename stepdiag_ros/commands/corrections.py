"""The correction of readings to 20 °C, as an option of the commands that solve a bag."""

from argparse import ArgumentParser, Namespace
from functools import partial
from typing import TYPE_CHECKING

from stepdiag_ros.commands.output import number

if TYPE_CHECKING:
    from stepdiag_ros.metrology.measurement import Measurement


def add_correction_options(parser: ArgumentParser) -> None:
    """Add the options of a correction to the reference temperature."""
    parser.add_argument(
        "--expansion-per-K",
        dest="expansion",
        type=partial(number, low=0.0, high=100e-6),
        metavar="COEFFICIENT",
        help="correct all displacements to 20 °C (ISO 1) with this coefficient of thermal"
        " expansion and the recorded temperature of the material; 11.5e-6 for steel. The bag keeps"
        " the uncorrected readings",
    )
    parser.add_argument(
        "--material-temperature",
        type=partial(number, low=-50.0, high=150.0),
        metavar="DEGREES",
        help="temperature of the material in °C, instead of the recorded one",
    )


def corrected(
    measurement: "Measurement", arguments: Namespace
) -> "tuple[Measurement, tuple[str, ...]]":
    """Return a measurement as the options ask for it, and in words what was done.

    Raises:
        ValueError: the material temperature is not known, or is given without a coefficient.
    """
    from stepdiag_ros.metrology.expansion import expansion_remark, to_reference_temperature

    if arguments.expansion is None:
        if arguments.material_temperature is not None:
            raise ValueError(
                "--material-temperature only serves a correction: give --expansion-per-K too"
            )
        return measurement, ()
    how = (arguments.expansion, arguments.material_temperature)
    return to_reference_temperature(measurement, *how), (expansion_remark(measurement, *how),)
