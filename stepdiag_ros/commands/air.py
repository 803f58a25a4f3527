"""The compensation of recorded readings for the air, as options of a command."""

from argparse import ArgumentParser, Namespace
from functools import partial
from typing import TYPE_CHECKING

from stepdiag_ros.commands.output import number
from stepdiag_ros.metrology.refusal import Refusal

if TYPE_CHECKING:
    from stepdiag_ros.metrology.air.recompensation import AirChoice

_OPTIONS = ("dead_path", "index_equation", "wavelength", "weather_age")
AS_MEASURED = dict.fromkeys(("air", *_OPTIONS))
"""The options, where none was given."""


def add_air_options(parser: ArgumentParser) -> None:
    """Add the options of a compensation that is made again from a bag."""
    parser.add_argument(
        "--air",
        choices=("own", "off"),
        help="compensate the recorded counts for the air again; own: with the recorded weather;"
        " off: no compensation, displacements are in vacuum wavelengths (default: displacements"
        " of the run)",
    )
    parser.add_argument(
        "--dead-path",
        type=partial(number, low=0.0, high=100.0),
        metavar="M",
        help="with --air own: distance from the interferometer's reference to the mirror at the"
        " first stop of a line, in m; default 0",
    )
    parser.add_argument(
        "--index-equation",
        choices=("edlen", "ciddor"),
        help="with --air own: equation for the refractive index; default edlen (the modified one)",
    )
    parser.add_argument(
        "--wavelength",
        type=partial(number, low=300e-9, high=1700e-9),
        metavar="M",
        help="with --air own: wavelength of the laser in vacuum, in m; default 632.9908e-9",
    )
    parser.add_argument(
        "--weather-age",
        type=partial(number, low=0.1, high=86400.0),
        metavar="S",
        help="with --air own: age in s above which the value of a sensor is unknown; default 10",
    )


def air_choice(arguments: Namespace) -> "AirChoice | None":
    """Return how to compensate again; None if it was not asked for.

    Raises:
        ValueError: an option serves nothing without another.
    """
    given = {name: getattr(arguments, name) for name in _OPTIONS}
    given = {name: value for name, value in given.items() if value is not None}
    if given and arguments.air != "own":
        option = "--" + next(iter(given)).replace("_", "-")
        raise Refusal(
            f"{option} only serves a compensation for the air: give --air own too",
            fault="mismatch",
            aspect="compensation",
        )
    if arguments.air is None:
        return None
    from stepdiag_ros.metrology.air.recompensation import AirChoice

    names = {"index_equation": "equation", "weather_age": "longest_age"}
    return AirChoice(arguments.air, **{names.get(name, name): given[name] for name in given})
