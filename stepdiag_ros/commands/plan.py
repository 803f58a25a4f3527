"""``stepdiag plan``: proposes a test plan, or states what an existing one will determine."""

import re
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stepdiag_ros.commands.arguments import Command, Group, add_common
from stepdiag_ros.commands.output import metres, number, say, warn

if TYPE_CHECKING:
    from stepdiag_ros.metrology.machine import Machine
    from stepdiag_ros.metrology.on_the_fly.expected import Streams
    from stepdiag_ros.metrology.plan import Plan, Sampling
    from stepdiag_ros.metrology.refusal import Findings
    from stepdiag_ros.planning.duration import Assumptions
    from stepdiag_ros.planning.nc_writing import Dialect
    from stepdiag_ros.planning.offers import StopNoise
    from stepdiag_ros.planning.proposal import PlanProposal
    from stepdiag_ros.planning.request import Request
    from stepdiag_ros.report.plan_files import PlanFiles

# Not taken from planning, whose numerics every start of the command line would wait for.
PURPOSES = ("squareness", "straightness", "volumetric", "angular", "iso230-2", "iso230-6", "quick")
DWELL_FORMS = ("P_ms", "P_s", "X_s", "F_s")
_DWELL_BY_HAND = 2.0
"""s: with a program for a machine that is not connected, where no other is wished."""
CHAINS = ("XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX")


def _add_options(parser: ArgumentParser) -> None:
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument(
        "--for",
        dest="purpose",
        choices=PURPOSES,
        metavar="PURPOSE",
        help=f"purpose of the plan: {', '.join(PURPOSES)}",
    )
    what.add_argument("--check", metavar="PLAN", help="check this plan: YAML file, or a name")
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument("--machine", help="YAML file, or a name, for example demo")
    where.add_argument(
        "--travel",
        nargs=3,
        type=_length,
        metavar=("X", "Y", "Z"),
        help="travel from 0 in m, in place of a machine file",
    )
    parser.add_argument(
        "--chain",
        choices=CHAINS,
        help="with --travel: order of the axes from workpiece to tool; needed for angular errors",
    )
    parser.add_argument(
        "--acceleration",
        type=_positive,
        metavar="M/S2",
        help="with --travel: acceleration of an axis (default: 1)",
    )
    parser.add_argument(
        "--noise",
        type=_positive,
        default=0.1,
        metavar="UM",
        help="standard uncertainty of one stop in µm, readings and repeatability of the machine"
        " together, that a longer dwell does not improve (default: 0.1)",
    )
    parser.add_argument(
        "--reading-noise",
        type=_not_negative,
        default=0.0,
        metavar="UM",
        help="standard uncertainty of the mean of one second of readings in µm; it falls with the"
        " root of the time that is averaged at a stop (default: 0)",
    )
    parser.add_argument(
        "--instrument",
        metavar="FILE",
        help="instrument as for 'stepdiag budget', YAML file or a name: its resolution and periodic"
        " error are added to --noise",
    )
    _add_wishes(parser)
    _add_streams(parser)
    _add_assumptions(parser)
    _add_files(parser)


def _add_wishes(parser: ArgumentParser) -> None:
    group = parser.add_argument_group("wishes, with --for")
    group.add_argument(
        "--until",
        metavar="U",
        help="expanded uncertainty (95 %%) to be reached, such as 1um or 5um/m of what counts for"
        " the purpose, or of one quantity: E_XX=0.3um, C0Y=2urad",
    )
    group.add_argument(
        "--time",
        type=_duration,
        metavar="T",
        help="longest duration, alignments included: 20min, 2h, 1h30min",
    )
    group.add_argument(
        "--from",
        dest="low",
        nargs=3,
        type=_coordinate,
        metavar=("X", "Y", "Z"),
        help="first corner of the box in machine coordinates (default: corner of the travel)",
    )
    group.add_argument(
        "--to",
        dest="high",
        nargs=3,
        type=_coordinate,
        metavar=("X", "Y", "Z"),
        help="last corner of the box",
    )
    group.add_argument(
        "--margin",
        type=_not_negative,
        metavar="M",
        help="margin at every end of the travel (default: 0.005)",
    )
    group.add_argument("--blocks", type=_count, help="number of blocks (default: optimised)")
    group.add_argument(
        "--spacing", type=_positive, metavar="M", help="largest distance between targets"
    )
    group.add_argument("--repeats", type=_count, help="repeats of every line (default: optimised)")
    group.add_argument("--one-way", action="store_true", help="run every line forward only")
    group.add_argument(
        "--feed", type=_positive, metavar="M/S", help="feed of moves (default: optimised)"
    )
    group.add_argument(
        "--dwell",
        type=_positive,
        metavar="S",
        help="shortest stay at a stop (default: optimised; with --nc 2, of which a quarter stays"
        " free for the settling of the drives, see docs/by_hand.md)",
    )
    group.add_argument(
        "--overrun",
        type=_not_negative,
        metavar="M",
        help="how far beyond its first target a pass of a line other than a step diagonal begins"
        " (default: 0.002 for iso230-2 and iso230-6, otherwise 0)",
    )


def _add_streams(parser: ArgumentParser) -> None:
    group = parser.add_argument_group("lines on the fly: measured while the axes move")
    group.add_argument(
        "--on-the-fly",
        action="store_true",
        help="with --for: choose lines on the fly where they take less time; the controller must"
        " publish its positions",
    )
    group.add_argument(
        "--reading-rate",
        type=_positive,
        metavar="HZ",
        help="readings of the laser in a second (default: 1000)",
    )
    group.add_argument(
        "--position-rate",
        type=_positive,
        metavar="HZ",
        help="positions of the controller in a second (default: 500)",
    )
    group.add_argument(
        "--jitter",
        type=_not_negative,
        metavar="US",
        help="standard deviation of the readings' time stamps in µs (default: 20)",
    )


def _add_assumptions(parser: ArgumentParser) -> None:
    group = parser.add_argument_group("assumptions for the duration")
    group.add_argument(
        "--align-linear",
        type=_not_negative,
        metavar="MIN",
        help="minutes to align laser and mirror for a linear line (default: 10). If neither this"
        " nor the next takes time, the plan waits for no alignment and runs the lines in rounds",
    )
    group.add_argument(
        "--align-diagonal",
        type=_not_negative,
        metavar="MIN",
        help="minutes to align laser and mirror for a diagonal (default: 20)",
    )


def _add_files(parser: ArgumentParser) -> None:
    group = parser.add_argument_group("files; none is overwritten without --force")
    add_common(
        group,
        "output",
        metavar="FILE",
        help="the plan (default with --for: PURPOSE_plan.yaml; none with --check)",
    )
    group.add_argument(
        "--nc",
        type=Path,
        nargs="?",
        const=Path(),
        metavar="FILE",
        help="write the NC program, too (default: beside the plan, .nc), and beside it the sheet"
        " for the operator (_sheet.txt)",
    )
    group.add_argument(
        "--table",
        type=Path,
        nargs="?",
        const=Path(),
        metavar="FILE",
        help="write an empty table with a row for each stop, to be filled in by hand (default:"
        " beside the plan, _readings.csv), and beside it the mapping for 'stepdiag import' (.yaml)",
    )
    group.add_argument(
        "--picture",
        type=Path,
        metavar="FILE",
        help="png, svg or pdf (default with --for: beside the plan, .png; none with --check)",
    )
    group.add_argument("--no-picture", action="store_true", help="write no picture")
    add_common(group, "force")
    group.add_argument(
        "--nc-dwell",
        choices=DWELL_FORMS,
        default="P_ms",
        help="how the controller reads a dwell: P_ms G4 P500, P_s G4 P0.5, X_s G4 X0.5,"
        " F_s G4 F0.5 for half a second (default: P_ms)",
    )
    group.add_argument("--nc-number", type=_count, metavar="N", help="O-number, 1 to 9999")
    group.add_argument("--nc-line-numbers", action="store_true", help="N10 N20 ...")
    group.add_argument("--nc-no-percent", action="store_true", help="leave out the lines '%%'")
    group.add_argument(
        "--nc-decimals",
        type=_count,
        default=4,
        metavar="N",
        help="decimals of a mm, 3 to 6 (default: 4)",
    )
    add_common(parser, "json", help="print JSON (SI units) instead of tables")


def _positive(text: str) -> float:
    return number(text, 1e-9, 1e9)


def _length(text: str) -> float:
    return metres(text, 1e-3, 100.0)


def _not_negative(text: str) -> float:
    return number(text, 0.0, 1e6)


def _duration(text: str) -> float:
    found = re.fullmatch(r"(?:([\d.]+)h)?(?:([\d.]+)min)?(?:([\d.]+)s)?", text.replace(" ", ""))
    if not text.strip() or not found:
        raise ArgumentTypeError(f"'{text}' is not a time such as 20min, 2h or 1h30min")
    hours, minutes, seconds = (number(part or "0", 0.0, 1e6) for part in found.groups())
    return number(str(3600.0 * hours + 60.0 * minutes + seconds), 1.0, 1e7)


def _coordinate(text: str) -> float:
    return metres(text, -100.0, 100.0)


def _count(text: str) -> int:
    if not text.isascii() or not text.isdigit() or not 1 <= int(text) <= 100_000:
        raise ArgumentTypeError(f"'{text}' is not a whole number from 1 on")
    return int(text)


def run(arguments: Namespace) -> int:
    """Propose or check a plan, show it, write the files."""
    import sys

    from stepdiag_ros.metrology.refusal import Findings
    from stepdiag_ros.planning.assessment import assess
    from stepdiag_ros.planning.duration import Assumptions
    from stepdiag_ros.planning.offers import StopNoise, noise_of_stops
    from stepdiag_ros.planning.proposal import check_request, propose
    from stepdiag_ros.report.documents.plan import assessment_json
    from stepdiag_ros.report.files import write_new
    from stepdiag_ros.report.plan_files import contents
    from stepdiag_ros.report.tables.plan import print_assessment
    from stepdiag_ros.text.console import make_console

    findings = Findings()
    _find_what_does_not_go_together(arguments, findings)
    machine = findings.of(lambda: _machine(arguments), None)
    noise = findings.of(lambda: _noise(arguments), StopNoise(1e-6, 0.0))
    assumptions = findings.of(lambda: _assumptions(arguments), Assumptions())
    proposal: PlanProposal | None = None
    files = findings.of(lambda: _files(arguments), None)
    if arguments.check is not None:
        plan = findings.of(lambda: _standing_plan(arguments.check), None)
        findings.refuse()
    else:
        nothing: dict[str, float] = {}
        until = findings.of(lambda: _until(arguments), nothing)
        if machine is not None:
            request = _request(arguments, machine, noise, assumptions, until)
            findings.of(lambda: check_request(request), None)
        findings.refuse()
        proposal = propose(request)
        plan = proposal.chosen.plan
    assert machine is not None
    assert plan is not None
    assert files is not None
    stops = noise_of_stops(plan, machine, noise, _streams(arguments, noise), assumptions)
    assessment = assess(plan, machine, stops, assumptions)
    written = contents(files, assessment, proposal)
    # Refused before anything is printed: the user must not take the plan for written.
    write_new(written, arguments.force)
    if arguments.json:
        print(assessment_json(assessment, proposal))
    else:
        print_assessment(assessment, make_console(sys.stdout), proposal)
    if assessment.undetermined.names:
        warn(assessment.undetermined.sentence)
    if written:
        say(f"wrote {', '.join(str(path) for path in written)}")
    return 0


def _find_what_does_not_go_together(arguments: Namespace, findings: "Findings") -> None:
    from stepdiag_ros.metrology.refusal import Refusal

    if arguments.machine is not None:
        for option in ("chain", "acceleration"):
            if getattr(arguments, option) is not None:
                words = f"--{option} goes with --travel; the file of --machine states it already"
                findings.found.append(Refusal(words, fault="mismatch", about=f"--{option}"))
    if arguments.check is None:
        return
    wishes = {
        "until": "until",
        "time": "time",
        "low": "from",
        "high": "to",
        "margin": "margin",
        "blocks": "blocks",
        "spacing": "spacing",
        "repeats": "repeats",
        "one_way": "one-way",
        "feed": "feed",
        "dwell": "dwell",
        "overrun": "overrun",
        "on_the_fly": "on-the-fly",
        "output": "output",
    }
    for name, option in wishes.items():
        if getattr(arguments, name) not in (None, False):
            words = f"--{option} goes with --for: a plan that is there is not changed"
            findings.found.append(Refusal(words, fault="mismatch", about=f"--{option}"))


def _standing_plan(name: str) -> "Plan":
    from stepdiag_ros import configuration

    plan = configuration.load_plan(name)[0]
    if plan.tracker is not None:
        raise ValueError(
            f"{name} is a plan with a tracker, which 'stepdiag tracker plan' checks when it makes"
            " the plan"
        )
    return plan


def _until(arguments: Namespace) -> dict[str, float]:
    """Return the wished uncertainties by quantity; empty without a wish."""
    from stepdiag_ros.planning.request import limits_of

    return {} if arguments.until is None else limits_of(arguments.purpose, arguments.until)


def _machine(arguments: Namespace) -> "Machine":
    from stepdiag_ros import configuration
    from stepdiag_ros.planning.candidates import travel_machine

    if arguments.machine is not None:
        return configuration.load_machine(arguments.machine)[0]
    return travel_machine(arguments.travel, arguments.chain or "", arguments.acceleration)


def _assumptions(arguments: Namespace) -> "Assumptions":
    from stepdiag_ros.planning.duration import Assumptions

    given: dict[str, Any] = {
        "linear_alignment_s": arguments.align_linear,
        "diagonal_alignment_s": arguments.align_diagonal,
    }
    return Assumptions(**{name: 60.0 * value for name, value in given.items() if value is not None})


def _sampling(arguments: Namespace) -> "Sampling | None":
    """Return how stops are read; None where the search may choose."""
    from stepdiag_ros.planning.request import sampling_with

    by_hand = arguments.nc is not None
    if arguments.dwell is None:
        return sampling_with(_DWELL_BY_HAND, by_hand) if by_hand else None
    return sampling_with(arguments.dwell, by_hand)


def _noise(arguments: Namespace) -> "StopNoise":
    """Return how uncertain a stop is, by the options and the instrument."""
    from math import hypot

    from stepdiag_ros import configuration
    from stepdiag_ros.planning.offers import StopNoise

    place = arguments.noise * 1e-6
    if arguments.instrument is not None:
        laser = configuration.load_instrument(arguments.instrument)[0]
        known = [one for one in (laser.resolution, laser.periodic_error) if one.known]
        place = hypot(place, *(one.standard_uncertainty for one in known))
    return StopNoise(place, arguments.reading_noise * 1e-6)


def _streams(arguments: Namespace, noise: "StopNoise") -> "Streams":
    """Return what laser and controller give while the axes move."""
    from stepdiag_ros.metrology.on_the_fly.expected import Streams

    given = {
        "reading_rate": arguments.reading_rate,
        "position_rate": arguments.position_rate,
        "stamp_jitter": None if arguments.jitter is None else arguments.jitter * 1e-6,
    }
    known = {name: value for name, value in given.items() if value is not None}
    return Streams(reading_noise=noise.reading, **known)


def _request(
    arguments: Namespace,
    machine: "Machine",
    noise: "StopNoise",
    assumptions: "Assumptions",
    until: dict[str, float],
) -> "Request":
    from stepdiag_ros.planning.request import Request

    given: dict[str, Any] = {
        "until": until or None,
        "time_limit": arguments.time,
        "feed": arguments.feed,
        "margin": arguments.margin,
        "low": None if arguments.low is None else tuple(arguments.low),
        "high": None if arguments.high is None else tuple(arguments.high),
        "blocks": arguments.blocks,
        "spacing": arguments.spacing,
        "repeats": arguments.repeats,
        "directions": ("forward",) if arguments.one_way else None,
        "overrun": arguments.overrun,
        "sampling": _sampling(arguments),
        "streams": _streams(arguments, noise) if arguments.on_the_fly else None,
    }
    return Request(
        purpose=arguments.purpose,
        machine=machine,
        stop_uncertainty=noise.place,
        reading_noise=noise.reading,
        assumptions=assumptions,
        **{name: value for name, value in given.items() if value is not None},
    )


def _files(arguments: Namespace) -> "PlanFiles":
    """Return which files are to be written; Refusal: they cannot be called or written so."""
    from stepdiag_ros.metrology.refusal import Refusal
    from stepdiag_ros.report.plan_files import PlanFiles

    is_new = arguments.check is None
    plan = arguments.output or Path(arguments.check or f"{arguments.purpose}_plan.yaml")
    if not plan.name:
        raise Refusal(f"{plan} is a folder; name a file", fault="mismatch")
    picture, table, program = arguments.picture, arguments.table, arguments.nc
    if picture is None and is_new and not arguments.no_picture:
        picture = plan.with_suffix(".png")
    if table == Path():
        table = plan.with_name(f"{plan.stem}_readings.csv")
    if program == Path():
        program = plan.with_suffix(".nc")
    files = PlanFiles(plan, is_new, picture, table, program, _dialect(arguments))
    files.refuse_existing(arguments.force)
    return files


def _dialect(arguments: Namespace) -> "Dialect":
    """Return how the program is to be written; ValueError: no control reads it."""
    from stepdiag_ros.planning.nc_writing import Dialect

    return Dialect(
        dwell=arguments.nc_dwell,
        decimals=arguments.nc_decimals,
        percent=not arguments.nc_no_percent,
        program_number=arguments.nc_number,
        line_numbers=arguments.nc_line_numbers,
    )


COMMAND = Command(
    "plan",
    Group.MEASURE,
    20,
    _add_options,
    run,
    help="propose a test plan for a machine, or check a plan",
    description="Propose a test plan for a machine's travel and a purpose: box, steps, lines,"
    " move orders, repeats, dwell and feed, by the information that they give per second for this"
    " machine, instrument and drift, and an order that a run may end early in. The command shows"
    " the duration, the alignments, the visibility and"
    " expected uncertainty of every error, and what the plan will not determine. It writes the"
    " plan (YAML, for 'stepdiag run --plan'), a picture, and with --nc the program for a machine"
    " that is not connected (ISO 6983 G-code). With --check it shows the same for an existing"
    " plan. Lengths are in metres, times in seconds, as in plan files; uncertainties in µm.",
    epilog="examples:\n"
    "  stepdiag plan --for volumetric --machine my_machine.yaml\n"
    "  stepdiag plan --for volumetric --machine demo --until 20um --time 2h\n"
    "  stepdiag plan --for squareness --travel 0.8 0.5 0.4 --chain YXZ --until 20urad\n"
    "  stepdiag plan --for straightness --machine demo --until 6um --nc\n"
    "  stepdiag plan --for volumetric --machine my_machine.yaml --table\n"
    "  stepdiag plan --check my_plan.yaml --machine my_machine.yaml --nc my_plan.nc",
)
