"""A diagnosis as one HTML page: the story in pictures, nothing loaded from elsewhere."""

import base64
from collections.abc import Mapping

import yaml

from stepdiag_ros.evaluation.diagnosis import DiagnosisReport, rms_and_largest
from stepdiag_ros.metrology.discrepancy.findings import (
    AMBIGUOUS,
    CONSISTENT,
    CONSISTENT_LEVEL,
    DESCRIBED,
    NAMED,
    UNEXPLAINED,
)
from stepdiag_ros.metrology.units import IN_MICRO
from stepdiag_ros.report.pages.page import Fact, environment
from stepdiag_ros.report.pages.sections.discrepancy import story_of
from stepdiag_ros.report.tables.diagnosis import model_words
from stepdiag_ros.text.numbers import UNKNOWN, plain, two_digits
from stepdiag_ros.words.diagnosis import chance, sizes_words

_COLOURS = {
    CONSISTENT: "#00694b",
    NAMED: "#00517f",
    AMBIGUOUS: "#8a5a00",
    DESCRIBED: "#a33e00",
    UNEXPLAINED: "#a33e00",
}
_OTHER_COLOUR = "#555555"


def diagnosis_page(report: DiagnosisReport, pictures: Mapping[str, bytes]) -> str:
    """Return the page: what was compared, where the gap is, what closes it, what is left.

    Args:
        report: what it tells.
        pictures: of ``diagnosis_figures.draw_diagnosis`` as PNG, by name.
    """
    diagnosis = report.diagnosis
    return (
        environment()
        .get_template("diagnosis.html")
        .render(
            **story_of(report),
            title=" ".join(part for part in ("Diagnosis", report.run_id) if part),
            colour=_COLOURS.get(diagnosis.verdict, _OTHER_COLOUR),
            sizes=[Fact(one.label, sizes_words(one)) for one in diagnosis.findings],
            tiles=_tiles(report),
            mapped=bool(diagnosis.map),
            tried=f"{diagnosis.tested:,}" if diagnosis.tested else "",
            named_title=_named_title(report),
            level=f"{CONSISTENT_LEVEL:g}",
            held_out=report.held_out is not None,
            untestable=bool(diagnosis.not_testable),
            origin=_origin(report),
            remarks=report.remarks,
            extended=""
            if report.extended is None
            else yaml.safe_dump(report.extended.to_mapping(), sort_keys=False, allow_unicode=True),
            pictures={
                name: f"data:image/png;base64,{base64.b64encode(data).decode('ascii')}"
                for name, data in pictures.items()
            },
        )
    )


def _tiles(report: DiagnosisReport) -> list[Fact]:
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
        tiles.append(Fact("gap (rms)", text))
    if diagnosis.noise > 0.0:
        tiles.append(Fact("noise of a stop", micro(diagnosis.noise)))
    fits = [(diagnosis.chi_squared_before, diagnosis.degrees_of_freedom_before)]
    if report.findings:
        fits.append((diagnosis.chi_squared_after, diagnosis.degrees_of_freedom_after))
    words = [plain(one / many, 2) if many > 0 else UNKNOWN for one, many in fits]
    tiles.append(Fact("χ² per degree of freedom", " → ".join(words)))
    if report.held_out is not None:
        proof = report.held_out
        reduced = (plain(proof.before.reduced, 2), plain(proof.after.reduced, 2))
        tiles.append(Fact("the same, held out", " → ".join(reduced)))
        gain = f"Δχ² {plain(proof.gain, 1)}, p {chance(proof.gain_p_value)}"
        tiles.append(Fact("the effect itself, held out", gain))
    if diagnosis.findings:
        least = min(finding.probability for finding in diagnosis.findings)
        tiles.append(Fact("probability of the name", chance(least)))
    tiles.append(Fact("candidates tried", f"{diagnosis.tested:,}"))
    return tiles


def _named_title(report: DiagnosisReport) -> str:
    if report.diagnosis.verdict == AMBIGUOUS:
        return "What would close it"
    return "Named" if report.diagnosis.findings else "What closes a part"


def _origin(report: DiagnosisReport) -> list[Fact]:
    """Return which runs and which model were compared, as far as that is known."""
    named = [
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
    return [Fact(name, text) for name, text in named if text]
