"""What is said first of a run, as a part of JSON documents."""

from typing import Any

from stepdiag_ros import schemas
from stepdiag_ros.evaluation.lead import RunLead
from stepdiag_ros.words.lead import next_steps, sentences_of


def lead_document(lead: RunLead) -> dict[str, Any]:
    """Return the lead as a document of the schema ``lead``: SI, unknown is null."""
    passes, volume = lead.passes, lead.volume
    content = {
        "recording": [flaw.as_dict() for flaw in lead.recording],
        "verdict": {
            "name": lead.verdict.name,
            "sentence": lead.verdict.sentence,
            "effects": list(lead.verdict.effects),
            "rivals": list(lead.verdict.rivals),
        },
        "passes": None
        if passes is None
        else {
            "planned": passes.planned,
            "complete": passes.complete,
            "unit": passes.unit,
            "missing": list(passes.missing),
            "end": passes.end or None,
        },
        "solved": lead.solved,
        "misfit": lead.misfit.name.lower() if lead.solved else None,
        "reduced_chi_squared": schemas.number(lead.reduced_chi_squared),
        "unknown": list(lead.unknown),
        "remedy": lead.remedy or None,
        "noise": lead.noise if volume is not None else None,
        "largest_in_volume": None if volume is None else volume.value,
        "expanded_uncertainty": schemas.number(lead.expanded_uncertainty),
        "single_errors": [
            {
                "name": one.name,
                "value": one.value,
                "expanded_uncertainty": schemas.number(one.expanded_uncertainty),
                "travel": one.travel,
            }
            for one in lead.errors
        ],
        "taken_as_zero": list(lead.as_zero),
        "sentences": sentences_of(lead),
        "next": [{"command": one.command or None, "why": one.why} for one in next_steps(lead)],
    }
    return schemas.document("lead", content)
