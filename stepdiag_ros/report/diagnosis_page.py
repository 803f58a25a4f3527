"""A diagnosis as one HTML page: the story in pictures, nothing loaded from elsewhere."""

import base64
import io
from collections.abc import Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING

import yaml
from rich.table import Table

from stepdiag_ros import __version__
from stepdiag_ros.metrology.discrepancy.findings import (
    AMBIGUOUS,
    CONSISTENT,
    NAMED,
    UNEXPLAINED,
)
from stepdiag_ros.report.diagnosis import (
    DiagnosisReport,
    extension_sentences,
    findings_table,
    gap_table,
    group_sentences,
    limits_table,
    model_words,
    noise_sentence,
    not_testable_sentences,
    runners_up_table,
    sizes_words,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Picture

_COLOURS = {
    CONSISTENT: "#00694b",
    NAMED: "#00517f",
    AMBIGUOUS: "#8a5a00",
    UNEXPLAINED: "#a33e00",
}
_OTHER_COLOUR = "#555555"
_STYLE = """\
:root { color-scheme: light; }
body { font: 16px/1.5 system-ui, sans-serif; color: #1a1a1a; background: #ffffff;
  max-width: 68rem; margin: 0 auto; padding: 1.5rem; }
header { border-left: 0.5rem solid VERDICT; padding: 0.2rem 1rem; margin-bottom: 2rem; }
header p { font-size: 1.2rem; margin: 0.3rem 0; }
h1 { margin: 0; font-size: 1.9rem; color: VERDICT; }
h2 { margin: 2.5rem 0 0.5rem; border-bottom: 1px solid #cccccc; }
figure { margin: 1rem 0; } img { max-width: 100%; height: auto; }
figcaption { color: #444444; font-size: 0.9rem; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; margin: 1rem 0; font-size: 0.9rem; }
caption { text-align: left; font-weight: 600; padding-bottom: 0.3rem; }
th, td { padding: 0.25rem 0.8rem 0.25rem 0; vertical-align: top; border-bottom: 1px solid #e4e4e4; }
th { text-align: left; border-bottom: 1px solid #888888; }
td.number, th.number { text-align: right; font-variant-numeric: tabular-nums; }
pre { background: #f4f4f4; padding: 0.8rem; overflow-x: auto; font-size: 0.85rem; }
code { overflow-wrap: anywhere; }
footer { margin-top: 3rem; color: #555555; font-size: 0.85rem; }
@media print { body { max-width: none; } h2 { break-after: avoid; }
  figure { break-inside: avoid; } }
"""


def diagnosis_page(report: DiagnosisReport, pictures: "Mapping[str, Picture]") -> str:
    """Return the page.

    Args:
        report: what it tells.
        pictures: of ``diagnosis_figures.draw_diagnosis``, by name.
    """
    diagnosis = report.diagnosis
    title = " ".join(part for part in ("Diagnosis", report.run_id) if part)
    body = [
        _header(report),
        "<h2>1 Before: the gap</h2>",
        _texts([noise_sentence(diagnosis)]),
        _picture(
            pictures,
            "gap_map",
            "Measured minus simulated at every stop of every pass, with everything that the model"
            " leaves free fitted.",
        ),
        "<h2>2 Where it is</h2>",
        _texts(diagnosis.where or ("No part of the run stands out from the noise.",)),
        _picture(pictures, "gap_where", "The gap split in several ways, beside the noise."),
        "<h2>3 Candidates ranked</h2>",
        *_candidates(report, pictures),
        "<h2>4 After: what is left</h2>",
        _table(gap_table(report)),
        _texts([*extension_sentences(report), *diagnosis.where_after]),
        _picture(pictures, "gap_traces", "The gap along every line."),
        _picture(pictures, "held_out", "Proof on readings that took no part in the fit."),
        _picture(pictures, "curves", "The error curves, solved before and after."),
        "<h2>5 What this run can and cannot show</h2>",
        _table(limits_table(report)),
        _texts(not_testable_sentences(report)),
        "<h2>6 Where this comes from</h2>",
        _origin(report),
    ]
    style = _STYLE.replace("VERDICT", _COLOURS.get(diagnosis.verdict, _OTHER_COLOUR))
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>\n{style}</style>\n</head>\n<body>\n"
        + "\n".join(part for part in body if part)
        + f"\n<footer>stepdiag_ros {escape(__version__)}</footer>\n</body>\n</html>\n"
    )


def _header(report: DiagnosisReport) -> str:
    diagnosis = report.diagnosis
    sizes = "".join(
        f"<p><strong>{escape(finding.label)}</strong>: {escape(sizes_words(finding))} (95 %)</p>"
        for finding in diagnosis.findings
    )
    return (
        f"<header>\n<h1>{escape(diagnosis.verdict)}</h1>\n<p>{escape(diagnosis.sentence)}</p>"
        f"{sizes}\n</header>"
    )


def _candidates(report: DiagnosisReport, pictures: "Mapping[str, Picture]") -> list[str]:
    found = report.findings
    if not found:
        return [_texts([f"{report.diagnosis.tested:,} candidates were tried; none was named."])]
    partly = not report.diagnosis.findings
    title = "Closes a part of the gap; not to be believed alone" if partly else "What is missing"
    return [
        _table(findings_table(found, title)),
        _texts(group_sentences(found)),
        _picture(pictures, "candidates", "What each candidate closes of the gap."),
        _table(runners_up_table(found)),
    ]


def _origin(report: DiagnosisReport) -> str:
    facts = [
        ("Run", report.run_id),
        ("File", "" if report.bag is None else report.bag.name),
        ("SHA-256", report.sha256),
        ("Model", model_words(report)),
    ]
    rows = "".join(
        f"<tr><th>{name}</th><td><code>{escape(text)}</code></td></tr>"
        for name, text in facts
        if text
    )
    parts = [f"<table>{rows}</table>", _texts(report.remarks)]
    if report.extended is not None:
        text = yaml.safe_dump(report.extended.to_mapping(), sort_keys=False, allow_unicode=True)
        parts.append(f"<p>The model with what was named:</p>\n<pre>{escape(text)}</pre>")
    return "\n".join(part for part in parts if part)


def _texts(sentences: Sequence[str]) -> str:
    return "\n".join(f"<p>{escape(sentence)}</p>" for sentence in sentences)


def _picture(pictures: "Mapping[str, Picture]", name: str, caption: str) -> str:
    if name not in pictures:
        return ""
    data = io.BytesIO()
    pictures[name].savefig(data, format="png")
    encoded = base64.b64encode(data.getvalue()).decode("ascii")
    return (
        f'<figure><img alt="{escape(caption)}" src="data:image/png;base64,{encoded}">'
        f"<figcaption>{escape(caption)}</figcaption></figure>"
    )


def _table(table: Table | None) -> str:
    """Return a table for a terminal as one of HTML."""
    if table is None or not table.row_count:
        return ""
    kinds = [' class="number"' if column.justify == "right" else "" for column in table.columns]
    head = "".join(
        f"<th{kind}>{escape(str(column.header))}</th>"
        for kind, column in zip(kinds, table.columns, strict=True)
    )
    rows = []
    for cells in zip(*(column.cells for column in table.columns), strict=True):
        marked = "".join(
            f"<td{kind}>{escape(str(cell)).replace(chr(10), '<br>')}</td>"
            for kind, cell in zip(kinds, cells, strict=True)
        )
        rows.append(f"<tr>{marked}</tr>")
    caption = f"<caption>{escape(str(table.title))}</caption>" if table.title else ""
    return (
        f'<div class="wide"><table>{caption}<thead><tr>{head}</tr></thead>'
        f"<tbody>{''.join(rows)}</tbody></table></div>"
    )
