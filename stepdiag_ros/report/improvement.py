"""How much better a machine has become, as a person and a program read it."""

import math
from dataclasses import asdict
from typing import Any

from stepdiag_ros import schemas
from stepdiag_ros.compensation.identified import Origin
from stepdiag_ros.compensation.improvement import Improvement
from stepdiag_ros.report.compensation import change_document, change_table
from stepdiag_ros.report.tables import PlainConsole

MEANING = (
    "positioning: range over the travel, both directions; straightness: range off its line;"
    " volume: length of the error vectors, counted from the first corner"
)


def print_improvement(found: Improvement, console: PlainConsole) -> None:
    """Print both measurements beside each other."""

    def sentence(text: str) -> None:
        console.print(text, width=console.text_width, soft_wrap=console.text_width is None)

    for title, one in (("before", found.before), ("after", found.after)):
        sentence(f"{title}: {one.origin.file} (run {one.origin.run_id}, {one.origin.method})")
    console.print()
    console.print(change_table("How much better", found.changes, with_tables=False))
    console.print()
    sentence(f"{MEANING}.")
    sentence(found.words)
    for title, one in (("before", found.before), ("after", found.after)):
        for remark in one.remarks:
            sentence(f"- {title}: {remark}")


def improvement_json(found: Improvement) -> str:
    """Return both as JSON text; SI, ``null`` where not known (schema ``improvement``)."""
    content = {
        "before": _origin(found.before.origin),
        "after": _origin(found.after.origin),
        "meaning": MEANING,
        "words": found.words,
        "changes": [change_document(one) for one in found.changes],
        "rms_standard_uncertainty": (
            found.rms_uncertainty if math.isfinite(found.rms_uncertainty) else None
        ),
    }
    return schemas.json_text(schemas.document("improvement", content))


def _origin(origin: Origin) -> dict[str, Any]:
    return {key: text or None for key, text in asdict(origin).items()}
