"""A diagnosis as one HTML page: the story in pictures, nothing loaded from elsewhere."""

import base64
from collections.abc import Mapping, Sequence
from html import escape

import yaml
from rich.table import Table

from stepdiag_ros import __version__
from stepdiag_ros.evaluation.diagnosis import DiagnosisReport, rms_and_largest
from stepdiag_ros.evaluation.not_testable import not_testable_sentences
from stepdiag_ros.metrology.discrepancy.findings import (
    AMBIGUOUS,
    CONSISTENT,
    CONSISTENT_LEVEL,
    NAMED,
    UNEXPLAINED,
)
from stepdiag_ros.metrology.units import IN_MICRO
from stepdiag_ros.report.tables.diagnosis import (
    extension_sentences,
    findings_table,
    findings_title,
    gap_table,
    group_sentences,
    known_sentences,
    limits_table,
    model_words,
    noise_sentence,
    physics_sentences,
    runners_up_tables,
)
from stepdiag_ros.report.tables.proposal import pairs_table
from stepdiag_ros.text.numbers import UNKNOWN, plain, two_digits
from stepdiag_ros.words.diagnosis import MEANING, chance, sizes_words
from stepdiag_ros.words.proposal import proposed_sentences

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
  max-width: 68rem; margin: 0 auto; padding: 1.5rem; overflow-wrap: break-word; }
header { border-left: 0.5rem solid VERDICT; padding: 0.2rem 1rem; margin-bottom: 2rem; }
header p { margin: 0.4rem 0; }
header .size { font-size: 1.25rem; }
header .meaning, .about { color: #444444; }
h1 { margin: 0; font-size: 2rem; color: VERDICT; }
h2 { margin: 2.5rem 0 0.5rem; border-bottom: 1px solid #cccccc; }
dl { display: flex; flex-wrap: wrap; gap: 0.6rem; margin: 1rem 0 0; }
dl div { border: 1px solid #cccccc; border-radius: 0.3rem; padding: 0.4rem 0.8rem; }
dt { color: #444444; font-size: 0.85rem; } dd { margin: 0; font-size: 1.15rem; font-weight: 600; }
figure { margin: 1rem 0; } img { width: 100%; height: auto; display: block; }
figcaption { color: #444444; font-size: 0.9rem; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; margin: 1rem 0; font-size: 0.9rem; }
caption { text-align: left; font-weight: 600; padding-bottom: 0.3rem; }
th, td { padding: 0.25rem 0.8rem 0.25rem 0; vertical-align: top; border-bottom: 1px solid #e4e4e4; }
th { text-align: left; border-bottom: 1px solid #888888; }
td.number, th.number { text-align: right; font-variant-numeric: tabular-nums;
  white-space: nowrap; }
pre { background: #f4f4f4; padding: 0.8rem; font-size: 0.85rem; white-space: pre-wrap;
  overflow-wrap: anywhere; }
code { overflow-wrap: anywhere; }
footer { margin-top: 3rem; color: #555555; font-size: 0.85rem; }
@media screen and (max-width: 46rem) {
  body { padding: 0.8rem; }
  figure .wide img { width: 46rem; max-width: none; }
  .rows thead { display: none; } .rows caption { display: block; }
  .rows table, .rows tbody, .rows tr { display: block; }
  .rows tr { border-bottom: 1px solid #888888; padding: 0.4rem 0; }
  .rows td, .rows td.number { display: flex; gap: 0.8rem; justify-content: space-between;
    text-align: right; white-space: normal; border: 0; padding: 0.1rem 0; }
  .rows td::before { content: attr(data-name); color: #555555; text-align: left; }
  .rows td:first-child { font-weight: 600; }
}
@media print {
  body { max-width: none; padding: 0; font-size: 10.5pt; }
  h2, caption { break-after: avoid; } h2 + *, caption + * { break-before: avoid; }
  figure, tr, dl, pre { break-inside: avoid; } thead { display: table-header-group; }
  .wide { overflow: visible; }
  header, dl div { print-color-adjust: exact; -webkit-print-color-adjust: exact; }
}
@page { margin: 15mm; }
"""


_NOTHING_STANDS_OUT = "No part of the run stands out from the noise."


def diagnosis_page(report: DiagnosisReport, pictures: Mapping[str, bytes]) -> str:
    """Return the page: what was compared, where the gap is, what closes it, what is left.

    Args:
        report: what it tells.
        pictures: of ``diagnosis_figures.draw_diagnosis`` as PNG, by name.
    """
    diagnosis = report.diagnosis
    title = " ".join(part for part in ("Diagnosis", report.run_id) if part)
    chapters = [(name, parts) for name, parts in _chapters(report, pictures) if any(parts)]
    body = [_header(report)]
    for number, (name, parts) in enumerate(chapters, 1):
        body += [f"<h2>{number} {name}</h2>", *parts]
    style = _STYLE.replace("VERDICT", _COLOURS.get(diagnosis.verdict, _OTHER_COLOUR))
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}: {escape(diagnosis.verdict)}</title>\n"
        f"<style>\n{style}</style>\n</head>\n<body>\n"
        + "\n".join(part for part in body if part)
        + f"\n<footer>stepdiag_ros {escape(__version__)}</footer>\n</body>\n</html>\n"
    )


def _chapters(
    report: DiagnosisReport, pictures: Mapping[str, bytes]
) -> list[tuple[str, list[str]]]:
    """Return the chapters in the order of the story, each with its parts of HTML."""
    diagnosis = report.diagnosis
    where = diagnosis.where or (() if not diagnosis.map else (_NOTHING_STANDS_OUT,))
    return [
        (
            "Before: the gap",
            [
                _about(
                    "The gap is what the run measured minus what the model of the machine gives at"
                    " the same stops, after everything that the model leaves free (error curves,"
                    " alignment of each setup, zeros) is fitted. Where nothing is missing it is"
                    " noise alone, without stripes or patches."
                ),
                _texts([noise_sentence(diagnosis), *known_sentences(diagnosis)]),
                _picture(
                    pictures,
                    "gap_map",
                    "Each row is one pass, each cell one stop: red where the run reads more than"
                    " the model, blue where less. → forward, ← backward, then the repeat.",
                ),
            ],
        ),
        (
            "Where it is",
            [
                _list(where),
                _picture(
                    pictures,
                    "gap_where",
                    "The same gap split in several ways. Orange parts are larger than noise makes"
                    " them; the dashed line is the noise of a reading.",
                ),
            ],
        ),
        ("Candidates ranked", _candidates(report, pictures)),
        (_named_title(report), _named(report)),
        (
            "What to measure next",
            [_texts(proposed_sentences(report)), _table(pairs_table(report.proposal))],
        ),
        (
            "After: what is left" if report.findings else "How well model and run agree",
            [
                _about(
                    "χ² per degree of freedom is near 1 where only noise is left. p is the chance"
                    f" of so bad a fit by noise alone: below {CONSISTENT_LEVEL:g} something is"
                    " missing."
                ),
                _table(gap_table(report)),
                _list(diagnosis.where_after),
                _picture(pictures, "gap_traces", "The gap along every line, one trace a pass."),
                _picture(
                    pictures,
                    "curves",
                    "The error curves as solved from the run as it is, and with the effects"
                    " taken off.",
                ),
            ],
        ),
        (
            "The proof: readings that were held out",
            []
            if report.held_out is None
            else [
                _texts(extension_sentences(report)),
                _picture(
                    pictures,
                    "held_out",
                    "A part of the run took no part in the fit, and was predicted from the rest"
                    " without and with the effects.",
                ),
            ],
        ),
        (
            "What this run cannot tell",
            [
                _table(limits_table(report)),
                _texts(["Not at all, whatever their size:"] if diagnosis.not_testable else []),
                _list(not_testable_sentences(report)),
            ],
        ),
        ("Where this comes from", [_origin(report)]),
    ]


def _header(report: DiagnosisReport) -> str:
    diagnosis = report.diagnosis
    sizes = "".join(
        f'<p class="size"><strong>{escape(finding.label)}</strong>:'
        f" {escape(sizes_words(finding))} (95 %)</p>"
        for finding in diagnosis.findings
    )
    place = escape(diagnosis.where[0]) if diagnosis.where else ""
    tiles = "".join(
        f"<div><dt>{name}</dt><dd>{escape(text)}</dd></div>" for name, text in _tiles(report)
    )
    return (
        f"<header>\n<h1>{escape(diagnosis.verdict)}</h1>\n{sizes}"
        f"<p>{escape(diagnosis.sentence)}</p>\n"
        + (f"<p>{place}</p>\n" if place else "")
        + f'<p class="meaning">{escape(MEANING.get(diagnosis.verdict, ""))}</p>\n'
        + (f"<dl>{tiles}</dl>\n" if tiles else "")
        + "</header>"
    )


def _tiles(report: DiagnosisReport) -> list[tuple[str, str]]:
    """Return the few figures that the verdict rests on."""
    diagnosis = report.diagnosis

    def micro(value: float) -> str:
        return f"{two_digits(value * IN_MICRO)} µm"

    tiles = []
    before = rms_and_largest(diagnosis.residual_before)[0]
    if before > 0.0 and diagnosis.degrees_of_freedom_before > 0:
        text = micro(before)
        if report.findings:
            text += f" → {micro(rms_and_largest(diagnosis.residual_after)[0])}"
        tiles.append(("gap (rms)", text))
    if diagnosis.noise > 0.0:
        tiles.append(("noise of a reading", micro(diagnosis.noise)))
    fits = [(diagnosis.chi_squared_before, diagnosis.degrees_of_freedom_before)]
    if report.findings:
        fits.append((diagnosis.chi_squared_after, diagnosis.degrees_of_freedom_after))
    words = [plain(one / many, 2) if many > 0 else UNKNOWN for one, many in fits]
    tiles.append(("χ² per degree of freedom", " → ".join(words)))
    if report.held_out is not None:
        proof = report.held_out
        reduced = (plain(proof.before.reduced, 2), plain(proof.after.reduced, 2))
        tiles.append(("the same, held out", " → ".join(reduced)))
        gain = f"Δχ² {plain(proof.gain, 1)}, p {chance(proof.gain_p_value)}"
        tiles.append(("the effect itself, held out", gain))
    if diagnosis.findings:
        least = min(finding.probability for finding in diagnosis.findings)
        tiles.append(("probability of the name", chance(least)))
    tiles.append(("candidates tried", f"{diagnosis.tested:,}"))
    return tiles


def _candidates(report: DiagnosisReport, pictures: Mapping[str, bytes]) -> list[str]:
    found = report.findings
    tried = f"{report.diagnosis.tested:,} candidates were tried"
    if not found:
        return [_texts([f"{tried}; none was named."]) if report.diagnosis.tested else ""]
    return [
        _about(
            f"{tried}, each fitted together with all that is free. Δχ² is how much of the gap a"
            " candidate closes; with so many, chance alone reaches some, which the chance p of"
            " each named effect takes into account."
        ),
        _picture(
            pictures,
            "candidates",
            "What each candidate closes of the gap; the best few that lost stand below each that"
            " was found.",
        ),
        *(_table(table) for table in runners_up_tables(found)),
    ]


def _named_title(report: DiagnosisReport) -> str:
    if report.diagnosis.verdict == AMBIGUOUS:
        return "What would close it"
    return "Named" if report.diagnosis.findings else "What closes a part"


def _named(report: DiagnosisReport) -> list[str]:
    found = report.findings
    if not found:
        return []
    return [
        _table(findings_table(found, findings_title(report.diagnosis))),
        _texts([*physics_sentences(found), *group_sentences(found)]),
    ]


def _origin(report: DiagnosisReport) -> str:
    facts = [
        ("Run", report.run_id),
        ("File", "" if report.bag is None else report.bag.name),
        ("SHA-256", report.sha256),
        *(
            fact
            for number, one in enumerate(report.further, 2)
            for fact in (
                (f"Run {number}", one.run_id),
                (f"File of run {number}", one.path.name),
                (f"SHA-256 of run {number}", one.sha256),
            )
        ),
        ("Model", model_words(report)),
    ]
    rows = "".join(
        f"<tr><th>{name}</th><td><code>{escape(text)}</code></td></tr>"
        for name, text in facts
        if text
    )
    parts = [f"<table>{rows}</table>", _texts(report.remarks)]
    if report.held_out is None:
        parts.append(_texts(extension_sentences(report)))
    if report.extended is not None:
        text = yaml.safe_dump(report.extended.to_mapping(), sort_keys=False, allow_unicode=True)
        parts.append(f"<p>The model with what was named:</p>\n<pre>{escape(text)}</pre>")
    return "\n".join(part for part in parts if part)


def _about(text: str) -> str:
    return f'<p class="about">{escape(text)}</p>'


def _texts(sentences: Sequence[str]) -> str:
    return "\n".join(f"<p>{escape(sentence)}</p>" for sentence in sentences)


def _list(sentences: Sequence[str]) -> str:
    if not sentences:
        return ""
    return "<ul>" + "".join(f"<li>{escape(one)}</li>" for one in sentences) + "</ul>"


def _picture(pictures: Mapping[str, bytes], name: str, caption: str) -> str:
    if name not in pictures:
        return ""
    encoded = base64.b64encode(pictures[name]).decode("ascii")
    return (
        f'<figure><div class="wide"><img alt="{escape(caption)}"'
        f' src="data:image/png;base64,{encoded}"></div>'
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
            f'<td{kind} data-name="{escape(str(column.header))}">'
            f"<span>{escape(str(cell)).replace(chr(10), '<br>')}</span></td>"
            for kind, column, cell in zip(kinds, table.columns, cells, strict=True)
        )
        rows.append(f"<tr>{marked}</tr>")
    caption = f"<caption>{escape(str(table.title))}</caption>" if table.title else ""
    return (
        f'<div class="wide rows"><table>{caption}<thead><tr>{head}</tr></thead>'
        f"<tbody>{''.join(rows)}</tbody></table></div>"
    )
