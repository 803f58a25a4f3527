"""``stepdiag report``: a measurement as one page for a customer: HTML, PDF and JSON."""

import sys
from argparse import ArgumentParser, Namespace
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from math import nan
from pathlib import Path
from typing import TYPE_CHECKING

from stepdiag_ros.commands.arguments import (
    Command,
    Controls,
    Group,
    add_bag,
    add_common,
    results_folder,
)
from stepdiag_ros.commands.corrections import add_correction_options, corrected
from stepdiag_ros.commands.direct_files import add_direct_option, direct_measurement
from stepdiag_ros.commands.output import (
    Progress,
    progress_bar,
    say,
    tolerance,
    warn,
    warn_of_replaced,
)
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.units import IN_MICRO
from stepdiag_ros.text.intake import refusals_of
from stepdiag_ros.text.sentence import sentence

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from stepdiag_ros.archive.histories import HistoryOfRun
    from stepdiag_ros.bags.run import RecordedRun
    from stepdiag_ros.report.certificate.laboratory import Laboratory
    from stepdiag_ros.report.pages.build import LaidOut
    from stepdiag_ros.report.pages.given import Given
    from stepdiag_ros.report.pages.material import Material
    from stepdiag_ros.report.pages.page import Lead
    from stepdiag_ros.report.pages.tracker import TrackerHandover

_PIECES = 20
"""Approximate number of pieces of work that a progress bar counts."""


def _add_options(parser: ArgumentParser) -> None:
    add_bag(parser)
    add_common(parser, "run")
    for name, what in (
        ("html", "write report.html, one file with everything in it"),
        ("pdf", "write report.pdf"),
        ("json", "write report.json, every number of the report in SI units"),
    ):
        parser.add_argument(f"--{name}", action="store_true", help=what)
    add_common(parser, "output", help="folder for the files (default: NAME_report beside the bag)")
    parser.add_argument(
        "--dcc",
        type=Path,
        metavar="CERT.xml",
        help="also write a digital calibration certificate (PTB's DCC 3.3.0), without a signature;"
        " needs --laboratory and --instrument",
    )
    parser.add_argument(
        "--laboratory",
        type=Path,
        metavar="FILE",
        help="YAML file with laboratory, customer, machine and signers, form: docs/dcc.md; the"
        " options below go before it",
    )
    _add_given(parser)
    parser.add_argument(
        "--control",
        choices=Controls(),
        metavar="CONTROL",
        default="generic",
        help="control to show compensation for: %(choices)s (default: generic, the whole error"
        " map)",
    )


def _add_given(parser: ArgumentParser) -> None:
    """Add the options for what a bag cannot know."""
    for name, what in (
        ("customer", "name of the customer"),
        ("operator", "who measured"),
        ("place", "place of the measurement"),
        ("serial", "serial number of the machine"),
        ("remark", "a further remark"),
    ):
        parser.add_argument(f"--{name}", default="", metavar="TEXT", help=what)
    parser.add_argument(
        "--tolerance",
        type=tolerance,
        metavar="UM",
        help="largest permissible error vector in the volume, µm; the first page then states"
        " whether the machine conforms (ISO 14253-1)",
    )
    parser.add_argument(
        "--instrument",
        metavar="NAME|FILE",
        help="instrument file: uncertainties of laser, sensors, material and setup, see 'stepdiag"
        " budget'. They make U of the error curves, of squareness and of the largest error",
    )
    parser.add_argument(
        "--uncertainty",
        type=Path,
        metavar="FILE",
        help="measuring conditions, see 'stepdiag iso230'. They make U of the parameters of ISO"
        " 230-2 and ISO 230-6; the U of a positioning error is then at least that of M",
    )
    add_direct_option(parser)
    add_correction_options(parser)
    parser.add_argument(
        "--archive",
        metavar="PLACE",
        help="archive of runs; the report then has the history of the machine, see 'stepdiag"
        " history'",
    )


def run(arguments: Namespace) -> int:
    """Make the report; see the module."""
    from stepdiag_ros.report.certificate.administration import require
    from stepdiag_ros.report.files import try_folder
    from stepdiag_ros.report.pages.build import FORMATS, NAMES
    from stepdiag_ros.report.pages.sections import sections
    from stepdiag_ros.text.console import make_console

    # Those of other packages may be broken: better refused than found out after all work is done.
    sections()
    formats = [name for name in FORMATS if getattr(arguments, name)] or list(FORMATS)
    folder = arguments.output or results_folder(arguments.bag, "report")
    stated = _stated(arguments, [folder / NAMES[name] for name in formats])
    given = _given(arguments, stated)
    if arguments.dcc is not None:
        require(given, stated)
    if arguments.bag.exists():
        try_folder(folder)
        if arguments.dcc is not None:
            try_folder(arguments.dcc.parent)
    leads: list[Lead] = []
    try:
        files = _make(arguments, given, stated, folder, formats, leads.append)
    finally:
        # Where a file cannot be written after all, the work was not in vain.
        console = make_console(sys.stdout)
        for text in (text for lead in leads for text in (lead.headline, *lead.sentences)):
            console.sentence(text)
    names = [path.name for path in files if path != arguments.dcc]
    say(f"report in {folder}: {', '.join(names)}")
    if arguments.dcc is not None:
        say(
            f"certificate: {arguments.dcc}, not signed. Check it, then sign it as a whole with an"
            " enveloped XML signature (docs/dcc.md)"
        )
    return 0


def _make(
    arguments: Namespace,
    given: "Given",
    stated: "Laboratory",
    folder: Path,
    formats: list[str],
    take_lead: "Callable[[Lead], None]",
) -> list[Path]:
    """Evaluate the bag, hand the lead on, and return the files that were written."""
    from stepdiag_ros.report.pages.build import prepare, report_document_of, write
    from stepdiag_ros.report.pages.lead import lead_of
    from stepdiag_ros.report.pages.pdf import get_ready
    from stepdiag_ros.report.pages.pictures import studio

    with ExitStack() as stack:
        atelier = None
        if arguments.bag.exists() and formats != ["json"]:
            # Drawing is got ready while the bag is read.
            atelier = stack.enter_context(studio())
        material = _material(arguments, given, stated, folder)
        # Not before: drawing is to be got ready without delay.
        from stepdiag_ros.report.pages.tracker import TrackerHandover

        with progress_bar("report") as progress, refusals_of(arguments.bag):
            tell = _counted(progress)
            further: dict[Path, Callable[[], bytes]] = {}
            if isinstance(material, TrackerHandover):
                document, lead = material.document, material.lead
                tell("pictures")
                if atelier is not None:
                    material.draw(atelier)
                handover: LaidOut | None = material
            else:
                # Pictures are asked for before all else, to be drawn while this process computes.
                handover = None
                if atelier is not None:
                    meanwhile = get_ready if "pdf" in formats else None
                    handover = prepare(material, atelier, tell, meanwhile)
                document, lead = partial(report_document_of, material), lead_of(material)
                if arguments.dcc is not None:
                    from stepdiag_ros.report.certificate.build import certificate

                    further[arguments.dcc] = partial(certificate, material, stated)
            take_lead(lead)
            return write(document, handover, folder, formats, tell, further)


def _material(
    arguments: Namespace, given: "Given", stated: "Laboratory", folder: Path
) -> "Material | TrackerHandover":
    from stepdiag_ros.bags.run import load_run
    from stepdiag_ros.evaluation.recorded_run import report_of_run
    from stepdiag_ros.metrology.solvers.limits import BUDGET, DIAGNOSIS
    from stepdiag_ros.report.certificate.administration import require_of_run
    from stepdiag_ros.report.pages.build import NAMES
    from stepdiag_ros.report.pages.material import Material, unsolved
    from stepdiag_ros.report.pages.tracker import TrackerHandover

    with progress_bar(f"reading {arguments.bag.name}") as progress:
        recorded = load_run(arguments.bag, arguments.run_id)
        if recorded.plan.tracker is not None:
            _refuse_options_of_curves(arguments)
        if arguments.dcc is not None:
            require_of_run(recorded, given, stated)
        warn_of_replaced(folder / NAMES["json"], recorded.run_id)
        if recorded.plan.tracker is not None:
            return TrackerHandover.of_run(recorded, given, progress, warn)
        if arguments.archive is not None:
            given = replace(given, history=_history(arguments.archive, recorded))
        direct = direct_measurement(arguments)
        try:
            report = report_of_run(
                recorded,
                progress,
                correct=given.correct,
                with_visibility=True,
                warn=warn,
                direct=direct,
                further=(DIAGNOSIS, BUDGET),
            )
        except ValueError as error:
            if not recorded.lines:
                raise
            # Tests of axes at uneven targets are not lines of a box, and still tests.
            report = unsolved(recorded, sentence(error), given.correct)
    return Material(recorded, report, given)


def _history(archive: str, recorded: "RecordedRun") -> "HistoryOfRun":
    """Return what an archive says of the machine of a run."""
    from stepdiag_ros.archive import require_libraries

    require_libraries()
    from stepdiag_ros.archive.catalogue import Catalogue
    from stepdiag_ros.archive.histories import history_of_run
    from stepdiag_ros.archive.place import Place
    from stepdiag_ros.bags.digest import sha256_of

    sha256 = sha256_of(recorded.path) if recorded.path.is_file() else ""
    with Catalogue(Place(archive)) as catalogue:
        return history_of_run(catalogue, sha256, str(recorded.machine.get("name", "")))


def _refuse_options_of_curves(arguments: Namespace) -> None:
    """Refuse what a run with a tracker has no use for, rather than leave it out in silence."""
    for option in ("tolerance", "instrument", "direct", "dcc", "archive", "expansion"):
        if getattr(arguments, option):
            name = "expansion-per-K" if option == "expansion" else option
            raise ValueError(
                f"{arguments.bag} was measured with a tracker: --{name} is for the error curves"
                " of step diagonals; leave it out"
            )


def _counted(progress: Progress) -> "Callable[[str], None]":
    """Return a callback that advances a progress bar by one piece of work."""
    count = 0

    def tell(text: str) -> None:
        nonlocal count
        count += 1
        progress(min(count / _PIECES, 1.0), text)

    return tell


def _stated(arguments: Namespace, others: "Iterable[Path]") -> "Laboratory":
    """Return what the file of the laboratory states; refuse a certificate that cannot be made."""
    from stepdiag_ros.configuration import read_yaml
    from stepdiag_ros.report.certificate.laboratory import Laboratory
    from stepdiag_ros.report.certificate.xml import refuse_unfit

    if arguments.dcc is not None:
        for option in ("laboratory", "instrument"):
            if getattr(arguments, option) is None:
                raise Refusal(
                    f"a certificate (--dcc) needs --{option} as well; see docs/dcc.md",
                    fault="missing",
                    about=f"--{option}",
                )
        refuse_unfit(arguments.dcc, others)
    path = arguments.laboratory
    return Laboratory() if path is None else Laboratory.from_mapping(read_yaml(path), str(path))


def _given(arguments: Namespace, stated: "Laboratory") -> "Given":
    from stepdiag_ros.configuration import load_instrument, read_yaml
    from stepdiag_ros.metrology.standards.positioning_uncertainty import UncertaintyDescription
    from stepdiag_ros.metrology.uncertainty.instrument import Instrument
    from stepdiag_ros.report.pages.given import Given

    instrument, conditions = Instrument(), UncertaintyDescription()
    if arguments.instrument is not None:
        instrument = load_instrument(arguments.instrument)[0]
    if arguments.uncertainty is not None:
        conditions = UncertaintyDescription.from_mapping(
            read_yaml(arguments.uncertainty), str(arguments.uncertainty)
        )
    return Given(
        customer=arguments.customer or stated.customer.name,
        operator=arguments.operator,
        place=arguments.place,
        serial=arguments.serial or stated.machine.serial,
        remark=arguments.remark,
        tolerance=nan if arguments.tolerance is None else arguments.tolerance / IN_MICRO,
        instrument=instrument,
        laser_serial=stated.instrument.serial,
        laser_certificate=stated.instrument.certificate,
        instrument_source=instrument.name if arguments.instrument is not None else "",
        conditions=conditions,
        control=arguments.control,
        correct=partial(corrected, arguments=arguments),
        expansion=nan if arguments.expansion is None else arguments.expansion,
        material_temperature=arguments.material_temperature,
    )


COMMAND = Command(
    "report",
    Group.UNDERSTAND,
    90,
    _add_options,
    run,
    help="write the report of a measurement: HTML, PDF and JSON",
    description="Write the report of a measurement: first, in plain words, whether the machine is"
    " within its limit, its largest error and where, how certain that is and what to do. Then"
    " machine, instrument, plan and weather, readings, error curves by all methods, Table 1,"
    " squareness, ISO 230-2 and ISO 230-6, the volume, uncertainty, the visibility of errors,"
    " whether the model explains the run, the remaining errors after compensation, and what"
    " is unknown. Without --html, --pdf or --json the command writes all three. A part"
    " without data in the bag says so.",
    epilog="examples:\n"
    "  stepdiag report run.mcap\n"
    '  stepdiag report run.mcap --tolerance 20 --customer "Mill & Sons" --operator "A. Dent"\n'
    "  stepdiag report run.mcap --instrument demo --control linuxcnc --pdf\n"
    "  stepdiag report run.mcap --instrument demo --expansion-per-K 11.5e-6    at 20 °C\n"
    "  stepdiag report run.mcap --instrument demo --dcc cert.xml --laboratory laboratory.yaml\n"
    "  stepdiag report run.mcap --archive /data/machines",
)
