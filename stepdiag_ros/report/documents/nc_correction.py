"""What was done to an NC program, and the proof of the remaining error: as text and as JSON."""

from dataclasses import dataclass
from math import isfinite

from stepdiag_ros import schemas
from stepdiag_ros.compensation import nc_proof
from stepdiag_ros.compensation.identified import Origin
from stepdiag_ros.compensation.nc_rewrite import RewriteSettings, Rewritten
from stepdiag_ros.schemas.nc_correction import Document, Remaining, Uncorrected
from stepdiag_ros.schemas.origin import origin_of

REVERSAL = (
    "targets are corrected by the mean of both directions of approach: reversal errors (backlash)"
    " stay, and belong into the control"
)
TOOL = (
    "the errors are those of the point that was measured; a tool of another length is displaced"
    " further by the rotations of the axes"
)
_MOST_SHOWN = 12


@dataclass(frozen=True)
class NcReport:
    """One rewritten program.

    Attributes:
        program: path of the original.
        program_sha256: of its bytes.
        written: path of the rewritten one; empty if it was not written.
        origin: of the error map.
        settings: how it was rewritten.
        rewritten: the program.
        proof: what remains.
        remarks: about the map.
    """

    program: str
    program_sha256: str
    written: str
    origin: Origin
    settings: RewriteSettings
    rewritten: Rewritten
    proof: nc_proof.Proof
    remarks: tuple[str, ...] = ()

    @property
    def all_remarks(self) -> tuple[str, ...]:
        """Return what the reader must know, each once."""
        return tuple(dict.fromkeys((*self.rewritten.remarks, *self.remarks, REVERSAL, TOOL)))


def text_lines(report: NcReport) -> list[str]:
    """Return the report as lines of text, lengths in µm and mm."""
    made, proof = report.rewritten, report.proof
    lines = [
        f"{report.program}: {made.changed} moves corrected, {proof.moves} feed moves over"
        f" {1e3 * proof.length:.1f} mm written as {proof.pieces}",
        f"map: {'; '.join(report.origin.lines()[:3])}",
        "",
        "error of the tool's way, µm        largest      rms   largest in line",
    ]
    rows = (
        ("feed moves before", proof.before),
        ("feed moves after", proof.after),
        ("ends of rapid moves before", proof.rapid_before),
        ("ends of rapid moves after", proof.rapid_after),
    )
    lines += [
        f"  {name:<30}{_micro(one.largest)}{_micro(one.rms)}   {one.line or '-'}"
        for name, one in rows
    ]
    lines += [
        "",
        f"tolerance: {1e6 * report.settings.tolerance:g} µm; standard uncertainty of the map itself"
        f" on these ways: {_micro(proof.map_uncertainty).strip()} µm at most",
    ]
    if made.held:
        lines.append(f"outside the measured box, corrected as at its edge: {_listed(made.held)}")
    for line, reason in made.uncorrected[:_MOST_SHOWN]:
        lines.append(f"line {line} is passed as it is: {reason}")
    if len(made.uncorrected) > _MOST_SHOWN:
        lines.append(f"… and {len(made.uncorrected) - _MOST_SHOWN} lines more")
    lines += [f"note: {remark}" for remark in report.all_remarks]
    return lines


def nc_json(report: NcReport) -> str:
    """Return the report as a document of the schema ``nc_correction``."""
    made, proof = report.rewritten, report.proof
    content = Document(
        program=report.program,
        program_sha256=report.program_sha256,
        written=report.written or None,
        origin=origin_of(vars(report.origin)),
        tolerance=report.settings.tolerance,
        decimals=report.settings.decimals,
        outside=report.settings.outside,
        changed_moves=made.changed,
        feed_moves=proof.moves,
        written_feed_moves=proof.pieces,
        feed_length=proof.length,
        before=_remaining(proof.before),
        after=_remaining(proof.after),
        map_standard_uncertainty=proof.map_uncertainty,
        rapid_before=_remaining(proof.rapid_before),
        rapid_after=_remaining(proof.rapid_after),
        held_lines=made.held,
        uncorrected=[Uncorrected(line=line, reason=reason) for line, reason in made.uncorrected],
        remarks=report.all_remarks,
    )
    return schemas.json_text(schemas.document("nc_correction", content))


def _remaining(one: nc_proof.Remaining) -> Remaining:
    return Remaining(
        largest=one.largest,
        rms=one.rms,
        line=one.line or None,
    )


def _micro(value: float) -> str:
    return f"{1e6 * value:9.3f}" if isfinite(value) else f"{'unknown':>9}"


def _listed(numbers: tuple[int, ...]) -> str:
    shown = ", ".join(str(number) for number in numbers[:_MOST_SHOWN])
    more = f" and {len(numbers) - _MOST_SHOWN} more" if len(numbers) > _MOST_SHOWN else ""
    return f"lines {shown}{more}" if len(numbers) > 1 else f"line {shown}"
