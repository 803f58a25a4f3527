"""Summary of a run, as a part of JSON documents."""

from math import nan
from typing import Any

from stepdiag_ros import schemas
from stepdiag_ros.evaluation.lead import RunLead
from stepdiag_ros.schemas.lead import Document, Flaw, Passes, SingleError, Step, Verdict
from stepdiag_ros.schemas.parts import part_of
from stepdiag_ros.words.lead import next_steps, sentences_of


def lead_document(lead: RunLead) -> dict[str, Any]:
    """Return the lead as a document of the schema ``lead``: SI, unknown is null."""
    passes, volume = lead.passes, lead.volume
    content = part_of(
        Document,
        lead,
        recording=[
            Flaw(kind=flaw.kind, sentence=flaw.sentence, messages=flaw.messages)
            for flaw in lead.recording
        ],
        verdict=part_of(Verdict, lead.verdict, contained=lead.verdict.contained),
        passes=None if passes is None else part_of(Passes, passes, end=passes.end or None),
        misfit=lead.misfit.name.lower() if lead.solved else None,
        remedy=lead.remedy or None,
        noise=lead.noise if volume is not None else None,
        expanded_uncertainty_of_readings=lead.expanded_uncertainty_of_readings,
        budgeted=lead.budgeted,
        lower_bound=lead.lower_bound,
        largest_in_volume=None if volume is None else volume.value,
        largest_at=[nan] * 3 if volume is None else volume.position,
        largest_upper_bound=(
            nan if volume is None else volume.upper_bound(lead.expanded_uncertainty)
        ),
        single_errors=[part_of(SingleError, one) for one in lead.errors],
        taken_as_zero=lead.as_zero,
        sentences=sentences_of(lead),
        next=[Step(command=one.command or None, why=one.why) for one in next_steps(lead)],
    )
    return schemas.document("lead", content)
