"""``stepdiag tracker``: measurements with an autotracking laser interferometer."""

from argparse import ArgumentParser, Namespace, _SubParsersAction
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stepdiag_ros import schemas
from stepdiag_ros.commands.arguments import Command, Group, add_common, picture_formats
from stepdiag_ros.commands.output import add_result_options, number, progress_bar, say
from stepdiag_ros.commands.standard_tests import add_output_options, show
from stepdiag_ros.commands.tracker_evaluate import run_evaluate, run_locate, run_points

if TYPE_CHECKING:
    from stepdiag_ros.metrology.geometry import Vector
    from stepdiag_ros.metrology.tracker.box import Box
    from stepdiag_ros.metrology.tracker.instrument import Tracker
    from stepdiag_ros.metrology.tracker.readings import TrackerReading
    from stepdiag_ros.planning.tracker_duration import SevenLineDuration

# Not taken from metrology, whose numerics every start of the command line would wait for.
CHAINS = ("XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX")

_TABLE = """\
places and readings are one CSV table, SI units, in order of time; the columns:
  station                 name of the tracker's place; its readings share one zero of the counter
  line                    locate (places that locate the tracker), x y z xy xz yz xyz, or grid
  run, direction, stop    run from 1, forward or backward, stop from 0 at the forward start
  x_m, y_m, z_m           commanded position of the machine
  length_change_m         since the counter was zeroed; empty in a plan
  standard_uncertainty_m  of the length; empty if not known
A station is given in machine coordinates: where the machine would have to go
for the reflector to meet the tracker's centre.
"""
_EXAMPLES = """\
examples:
  stepdiag tracker plan --machine demo --station -0.2 0.1 0.05 --nc
  stepdiag tracker plan --box 0 0 0 .12 .12 .12 --station -.15 .15 -.15   where the cell has errors
  stepdiag tracker simulate tracker_plan/places.csv --cell angular --station -.15 .15 -.15
  stepdiag tracker evaluate readings.csv --chain YXZ --cell angular       beside the true errors
  stepdiag tracker locate readings.csv          only where the tracker stands
  stepdiag tracker multilaterate grid.csv --chain YXZ
  stepdiag tracker figures                      Figs. 4 and 5 of Chen et al. 2018, computed"""


def _add_options(parser: ArgumentParser) -> None:
    what = parser.add_subparsers(title="subcommand", metavar="WHAT", dest="what", required=True)
    _add_plan(what)
    _add_simulate(what)
    for name, run, text in (
        ("locate", run_locate, "locate the tracker from six or more places"),
        ("evaluate", run_evaluate, "evaluate a seven-line test"),
    ):
        one = _command(what, name, text, run)
        _add_readings(one)
        add_output_options(one, f"NAME_{name} beside the table")
        one.add_argument("--station", default="", help="name of the station, if there are several")
        if name == "evaluate":
            one.add_argument(
                "--uncertainty",
                type=Path,
                metavar="FILE",
                help="measuring conditions for U of ISO 230-2 and -6, as for 'stepdiag iso230'",
            )
            one.add_argument(
                "--chain", choices=CHAINS, default="", help="axes from workpiece to tool, if known"
            )
            _add_cell(one)
    points = _command(
        what, "multilaterate", "find points and error curves from four or more stations", run_points
    )
    _add_readings(points)
    points.add_argument(
        "--chain", choices=CHAINS, required=True, help="axes from workpiece to tool"
    )
    _add_cell(points)
    add_result_options(points, "NAME_multilaterate beside the table")
    figures = _command(what, "figures", "compute Figs. 4 and 5 of Chen et al. 2018", run_figures)
    add_output_options(figures, "tracker_figures")


def _command(
    what: "_SubParsersAction[ArgumentParser]", name: str, text: str, run: Any
) -> ArgumentParser:
    parser: ArgumentParser = what.add_parser(
        name,
        help=text,
        description=text[0].upper() + text[1:] + ".",
        epilog=_TABLE + "\n" + _EXAMPLES,
    )
    parser.set_defaults(run=run)
    return parser


def _add_readings(parser: ArgumentParser) -> None:
    parser.add_argument("table", type=Path, help="readings (.csv), see below")
    _add_tracker(parser)


def _add_cell(parser: ArgumentParser) -> None:
    parser.add_argument(
        "--cell", metavar="NAME", help="compare with the true errors of this simulated cell"
    )


def _add_tracker(parser: ArgumentParser) -> None:
    parser.add_argument(
        "--tracker", default="demo", help="YAML file, or a name (default: demo): limits and noise"
    )


def _add_station(parser: ArgumentParser) -> None:
    parser.add_argument(
        "--station",
        nargs=3,
        type=partial(number, low=-100.0, high=100.0),
        action="append",
        required=True,
        metavar=("X", "Y", "Z"),
        help="place of the tracker in machine coordinates, m; again for each further station",
    )


def _add_plan(what: "_SubParsersAction[ArgumentParser]") -> None:
    parser = _command(
        what, "plan", "plan the target positions, a picture and the NC program", run_plan
    )
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument("--machine", help="YAML file, or a name: its travel is the volume")
    where.add_argument(
        "--box",
        nargs=6,
        type=partial(number, low=-100.0, high=100.0),
        metavar=("X0", "Y0", "Z0", "X1", "Y1", "Z1"),
        help="the volume in machine coordinates, m",
    )
    _add_station(parser)
    _add_tracker(parser)
    parser.add_argument(
        "--grid",
        type=int,
        metavar="N",
        help="plan N x N x N places for multilateration instead of seven lines",
    )
    parser.add_argument(
        "--targets", type=int, default=11, help="targets on each line (default: 11)"
    )
    parser.add_argument("--runs", type=int, default=5, help="runs in each direction (default: 5)")
    parser.add_argument(
        "--places", type=int, default=10, help="places that locate it (default: 10)"
    )
    parser.add_argument(
        "--overrun",
        type=partial(number, low=0.0, high=1.0),
        default=2e-3,
        metavar="M",
        help="overrun beyond the first and last target, m (default: 0.002)",
    )
    parser.add_argument("--nc", action="store_true", help="write the NC programs (ISO 6983)")
    parser.add_argument(
        "--feed",
        type=partial(number, low=1e-6, high=10.0),
        default=0.05,
        metavar="M/S",
        help="feed of all moves, m/s (default: 0.05)",
    )
    parser.add_argument(
        "--dwell",
        type=partial(number, low=0.0, high=600.0),
        default=3.0,
        metavar="S",
        help="dwell at each place, s (default: 3)",
    )
    add_common(parser, "output", default=Path("tracker_plan"))
    add_common(parser, "pictures")
    add_common(parser, "force", help="replace existing files")
    add_common(parser, "json", help="print the names of the files as JSON")


def _add_simulate(what: "_SubParsersAction[ArgumentParser]") -> None:
    parser = _command(
        what, "simulate", "measure planned places on a simulated machine", run_simulate
    )
    parser.add_argument("table", type=Path, help="places (.csv), see below")
    _add_station(parser)
    _add_tracker(parser)
    parser.add_argument("--cell", required=True, help="YAML file, or a name: the machine's errors")
    add_common(parser, "seed")
    add_common(parser, "output", metavar="FILE", help="default: readings.csv beside the table")
    add_common(parser, "force", help="replace an existing file")
    add_common(parser, "json", help="print the names of the files as JSON")


def run_plan(arguments: Namespace) -> int:
    """Plan a measurement; see the module."""
    import sys

    import numpy as np

    from stepdiag_ros.bags.tracker_table import table_text
    from stepdiag_ros.configuration import load_tracker
    from stepdiag_ros.metrology.plan import Sampling
    from stepdiag_ros.metrology.tracker.campaign import grid_readings
    from stepdiag_ros.metrology.tracker.expectation import expect
    from stepdiag_ros.metrology.tracker.measured_lines import plan_of
    from stepdiag_ros.metrology.tracker.readings import points_of, stations_of
    from stepdiag_ros.metrology.tracker.seven_lines import make_test
    from stepdiag_ros.planning.plan_text import plan_text
    from stepdiag_ros.planning.tracker_program import tracker_program
    from stepdiag_ros.plots.tracker import tracker_space
    from stepdiag_ros.report.publish import write_results
    from stepdiag_ros.report.tables.tracker_plan import duration_sentences, print_test
    from stepdiag_ros.text.console import make_console

    tracker, _ = load_tracker(arguments.tracker)
    box = _box(arguments)
    stations = [np.array(station) for station in arguments.station]
    console = make_console(sys.stderr if arguments.json else sys.stdout)
    drawn: dict[str, Any] = {}
    durations: list[SevenLineDuration | str] = []
    if arguments.grid is not None:
        readings = grid_readings(box, stations, tracker, arguments.grid)
        locating = np.unique(points_of(readings), axis=0)
        console.print(f"{len(readings)} places of a grid from {len(stations)} stations")
    else:
        found: list[TrackerReading] = []
        for count, station in enumerate(stations, start=1):
            test = make_test(
                box,
                station,
                tracker,
                targets=arguments.targets,
                runs=arguments.runs,
                overrun=arguments.overrun,
                locating=arguments.places,
            )
            found += test.readings(str(count))
            durations.append(_duration(arguments, test.readings(), station, tracker, box))
            print_test(test, expect(test, tracker, _chain(arguments)), str(count), console)
            for text in duration_sentences(durations[-1]):
                console.print(text)
            drawn, locating = {line.name: line.targets for line in test.lines}, test.locating
        readings = tuple(found)
    plan = plan_of(
        readings,
        {str(count): station for count, station in enumerate(stations, start=1)},
        tracker,
        box,
        name=f"{'Grid' if arguments.grid is not None else 'Seven lines'} with {tracker.name}",
        feed=arguments.feed,
        overrun=0.0 if arguments.grid is not None else arguments.overrun,
        sampling=Sampling(dwell=arguments.dwell),
    )
    contents = {"places.csv": table_text(readings), "plan.yaml": plan_text(plan)}
    if arguments.nc:
        for (name, group), station in zip(stations_of(readings).items(), stations, strict=True):
            contents[f"station_{name}.nc"] = tracker_program(
                group,
                station,
                tracker,
                box,
                feed_m_per_s=arguments.feed,
                name=f"Tracker measurement, station {name}",
                dwell_s=arguments.dwell,
                overrun=0.0 if arguments.grid is not None else arguments.overrun,
            )
    formats = picture_formats(arguments)
    _refuse_overwriting((arguments.output / name for name in contents), arguments.force)
    with progress_bar("writing"):
        files = write_results(
            arguments.output,
            contents,
            lambda: {"places": tracker_space(box, stations, locating, drawn)},
            formats,
        )
    if arguments.json:
        from stepdiag_ros.schemas.tracker_plan import Document, Duration

        content = Document(
            files=[str(path) for path in files],
            places=len(readings),
            durations=[
                None if isinstance(one, str) else Duration(tracker=one.tracker, laser=one.laser)
                for one in durations
            ],
        )
        print(schemas.json_text(schemas.document("tracker_plan", content)))
    else:
        say(f"written into {arguments.output}: {', '.join(path.name for path in files)}")
    return 0


def _chain(arguments: Namespace) -> str:
    from stepdiag_ros.configuration import load_machine

    return load_machine(arguments.machine)[0].chain if arguments.machine else ""


def _duration(
    arguments: Namespace,
    readings: "tuple[TrackerReading, ...]",
    station: "Vector",
    tracker: "Tracker",
    box: "Box",
) -> "SevenLineDuration | str":
    """Return how long a station takes on the machine, or in words why that is not known."""
    from stepdiag_ros.configuration import load_machine
    from stepdiag_ros.planning.tracker_duration import seven_line_duration

    machine, _ = load_machine(arguments.machine or "demo")
    try:
        return seven_line_duration(
            readings,
            station,
            tracker,
            box,
            machine,
            feed=arguments.feed,
            dwell=arguments.dwell,
            overrun=arguments.overrun,
        )
    except ValueError as error:
        return str(error)


def run_simulate(arguments: Namespace) -> int:
    """Simulate readings; see the module."""
    import numpy as np

    from stepdiag_ros.bags.tracker_table import read_table, table_text
    from stepdiag_ros.configuration import load_cell, load_tracker
    from stepdiag_ros.metrology.tracker.campaign import simulate_readings
    from stepdiag_ros.report.publish import write_results

    tracker, _ = load_tracker(arguments.tracker)
    cell, _ = load_cell(arguments.cell)
    readings = simulate_readings(
        read_table(arguments.table, planned=True),
        [np.array(station) for station in arguments.station],
        tracker,
        cell,
        arguments.seed,
    )
    target = arguments.output or arguments.table.parent / "readings.csv"
    _refuse_overwriting([target], arguments.force)
    write_results(target.parent, {target.name: table_text(readings)}, dict, ())
    if arguments.json:
        from stepdiag_ros.schemas.tracker_readings import Document

        content = Document(table=str(target), readings=len(readings))
        print(schemas.json_text(schemas.document("tracker_readings", content)))
    else:
        print(f"{target}: {len(readings)} readings")
    return 0


def run_figures(arguments: Namespace) -> int:
    """Compute the document's figures; see the module."""
    from stepdiag_ros.metrology.tracker.document_figures import figure_five, figure_four
    from stepdiag_ros.plots.tracker import tracker_document
    from stepdiag_ros.report.documents.tracker import figures_json
    from stepdiag_ros.report.tables.tracker import location_table
    from stepdiag_ros.words.tracker import figure_sentences

    four, five = figure_four(), figure_five()

    def tell(console: Any) -> None:
        console.print(location_table(five.location))
        for text in figure_sentences(four, five):
            console.sentence(text)

    return show(
        "tracker_figures",
        figures_json(four, five),
        tell,
        lambda: tracker_document(four, five),
        arguments,
        Path("tracker_figures"),
    )


def _refuse_overwriting(paths: Iterable[Path], force: bool) -> None:
    for path in paths:
        if path.exists() and not force:
            raise ValueError(f"{path} is there already; --force replaces it")


def _box(arguments: Namespace) -> "Box":
    import numpy as np

    from stepdiag_ros.configuration import load_machine
    from stepdiag_ros.metrology.tracker.box import Box

    if arguments.box:
        return Box(np.array(arguments.box[:3]), np.array(arguments.box[3:]))
    machine, _ = load_machine(arguments.machine)
    return Box(np.array(machine.travel_low_m), np.array(machine.travel_high_m))


COMMAND = Command(
    "tracker",
    Group.MEASURE,
    60,
    _add_options,
    None,
    help="measure with an autotracking laser interferometer",
    description="Seven-line test and multilateration with a tracking interferometer: plan the"
    " target positions and the NC program, locate the tracker, separate positioning errors from"
    " squareness errors, evaluate the lines by ISO 230-2 and ISO 230-6, and find all points and"
    " error curves from four or more stations.",
    epilog=_TABLE + "\n" + _EXAMPLES,
)
