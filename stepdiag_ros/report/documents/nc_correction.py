"""A rewritten NC program and its remaining error as a JSON document."""

from stepdiag_ros import schemas
from stepdiag_ros.compensation import nc_proof
from stepdiag_ros.evaluation.nc_correction import NcReport
from stepdiag_ros.schemas.nc_correction import Document, Remaining, Uncorrected
from stepdiag_ros.schemas.origin import origin_of


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
    return Remaining(largest=one.largest, rms=one.rms, line=one.line or None)
