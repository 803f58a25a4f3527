"""The files of a plan: what they are called, and what is in them."""

from dataclasses import dataclass
from pathlib import Path

from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.planning.assessment import Assessment
from stepdiag_ros.planning.candidates import PURPOSES
from stepdiag_ros.planning.moves import program_of
from stepdiag_ros.planning.nc_writing import Dialect
from stepdiag_ros.planning.operator_sheet import operator_sheet
from stepdiag_ros.planning.plan_text import plan_text
from stepdiag_ros.planning.proposal import PlanProposal
from stepdiag_ros.planning.reading_table import reading_table, table_mapping
from stepdiag_ros.plots.formats import format_of
from stepdiag_ros.report.files import check_new
from stepdiag_ros.report.tables.plan import head_of_plan


@dataclass(frozen=True)
class PlanFiles:
    """Which files of a plan are written, and where.

    Attributes:
        plan: the plan itself, or only its name, after which the others are called.
        is_new: the plan is written; False: it was there before.
        picture: of the plan; None: not written, as for the others.
        table: for readings that are taken by hand.
        program: NC program.
        dialect: of the program.

    Raises:
        Refusal: no picture has such an ending.
    """

    plan: Path
    is_new: bool
    picture: Path | None
    table: Path | None
    program: Path | None
    dialect: Dialect

    def __post_init__(self) -> None:
        if self.picture is not None:
            format_of(self.picture)

    @property
    def mapping(self) -> Path | None:
        """For the import of the table."""
        return None if self.table is None else self.table.with_suffix(".yaml")

    @property
    def sheet(self) -> Path | None:
        """For the operator of the program."""
        if self.program is None:
            return None
        return self.program.with_name(f"{self.program.stem}_sheet.txt")

    @property
    def frontier(self) -> Path | None:
        """The picture of uncertainty against time, where the search has found several plans."""
        if self.picture is None or not self.is_new:
            return None
        return self.picture.with_stem(f"{self.picture.stem}_frontier")

    def refuse_existing(self, overwrite: bool) -> None:
        """Refuse, before any work, what ``write_new`` would refuse after it.

        Raises:
            Refusal: a file is there already, its folder is not, or two have the same name.
        """
        named = (self.program, self.sheet, self.table, self.mapping, self.picture, self.frontier)
        beside = [path for path in named if path is not None]
        if self.is_new:
            beside.insert(0, self.plan)
        elif self.plan.resolve() in [path.resolve() for path in beside]:
            raise Refusal(
                f"{self.plan} is the plan that is checked; name the other file otherwise",
                fault="mismatch",
            )
        check_new(beside, overwrite)


def contents(
    files: PlanFiles, assessment: Assessment, proposal: PlanProposal | None
) -> dict[Path, bytes]:
    """Return the content of every file that is to be written.

    Args:
        files: which these are.
        assessment: of the plan.
        proposal: None if the plan was there before.

    Raises:
        Refusal: the program cannot be written in this dialect.
    """
    plan, machine = assessment.plan, assessment.machine
    found: dict[Path, bytes] = {}
    if proposal is not None:
        found[files.plan] = plan_text(plan, head_of_plan(assessment, proposal)).encode("utf-8")
    if files.program is not None and files.sheet is not None:
        found[files.program] = program_of(plan, machine, files.dialect).encode("ascii")
        found[files.sheet] = _sheet(files, files.program, assessment).encode("utf-8")
    if files.table is not None and files.mapping is not None:
        found[files.table] = reading_table(plan).encode("utf-8")
        found[files.mapping] = table_mapping(plan, machine).encode("utf-8")
    if files.picture is not None:
        found |= _pictures(files, files.picture, assessment, proposal)
    return found


def _sheet(files: PlanFiles, program: Path, assessment: Assessment) -> str:
    return operator_sheet(
        assessment.plan,
        assessment.machine,
        program.name,
        str(files.plan),
        assessment.duration.assumptions,
        "" if files.table is None else files.table.name,
    )


def _pictures(
    files: PlanFiles, picture: Path, assessment: Assessment, proposal: PlanProposal | None
) -> dict[Path, bytes]:
    # matplotlib is slow to import, so it is only here that a picture is asked for.
    from stepdiag_ros import plots
    from stepdiag_ros.plots.saving import file_bytes

    figure = plots.plan(assessment.plan, assessment.machine)
    drawn = {picture: file_bytes(figure, format_of(picture))}
    if files.frontier is not None and proposal is not None and len(proposal.front) > 1:
        chosen = proposal.chosen
        figure = plots.frontier(
            [(one.duration.total, one.uncertainty) for one in proposal.front],
            (chosen.duration.total, chosen.uncertainty),
            PURPOSES[proposal.request.purpose].unit,
            small_print=(
                f"U: expected expanded uncertainty (95 %) of {proposal.figure}.",
                f"Proposed: {proposal.reason}.",
            ),
        )
        drawn[files.frontier] = file_bytes(figure, format_of(files.frontier))
    return drawn
