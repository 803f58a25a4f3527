"""The statements of a certificate: conformity, where ISO 14253-1 allows it, and its limits."""

from collections.abc import Iterator
from xml.etree.ElementTree import Element

from stepdiag_ros.report.certificate.results import VOLUME_ID, decision, own
from stepdiag_ros.report.certificate.xml import METRE, element, quantity, real, words
from stepdiag_ros.report.pages.lead import EXCEEDS, KEEPS, verdict_words
from stepdiag_ros.report.pages.material import Material
from stepdiag_ros.report.pages.sections.unknown import unknowns
from stepdiag_ros.report.pages.summary import DECISION_RULE, DECISIONS
from stepdiag_ros.words.lead import missing_words

_CONFORMITY = {KEEPS: "pass", EXCEEDS: "fail"}
"""Verdict → status of the DCC; any other verdict has none."""


def statements(material: Material) -> Element:
    """Return all statements."""
    return element("dcc:statements", *_statements(material))


def _statements(material: Material) -> Iterator[Element]:
    yield _statement(
        "Scope",
        "The results refer to the calibrated machine alone, at the time of the measurement and in"
        " the measured volume, with the compensation that its control applied.",
        own("scope"),
    )
    if material.report.simulated:
        yield _statement(
            "Simulation",
            "The machine is simulated. This document is a demonstration, not a calibration"
            " certificate.",
            own("simulated"),
        )
    yield _statement("Model and run", f"{verdict_words(material)}.", own("diagnosis"))
    if not material.lead.whole:
        said = f"The plan was not measured completely. Missing: {missing_words(material.lead)}."
        yield _statement("Completeness", said, own("completeness"))
    if errors := unknowns(material).get("Not determined by the measured lines"):
        yield _statement("Unknown errors", " ".join(errors), own("unknown"))
    yield from _conformity(material)


def _statement(name: str, text: str, meaning: str) -> Element:
    return element(
        "dcc:statement",
        words("dcc:name", name),
        words("dcc:declaration", text),
        ref_type=meaning,
    )


def _conformity(material: Material) -> Iterator[Element]:
    """Yield the decision on the tolerance; nothing where none was agreed."""
    judged = decision(material)
    if judged is None:
        return
    status = _CONFORMITY.get(judged.verdict)
    limit = quantity(
        "Largest permissible length of an error vector in the volume",
        "basic_toleranceLimitUpper",
        real(judged.tolerance, METRE),
    )
    yield element(
        "dcc:statement",
        words("dcc:name", "Conformity"),
        element("dcc:norm", "ISO 14253-1:2017"),
        words(
            "dcc:declaration",
            f"Decision rule: {DECISION_RULE}. Decision on the largest error vector in the measured"
            f" volume: {DECISIONS[judged.verdict]}{judged.reservation}."
            f" {judged.basis if judged.decided else ''}".rstrip(),
        ),
        element("dcc:conformity", status) if status is not None else None,
        element("dcc:data", limit),
        ref_type="basic_conformity",
        refId=VOLUME_ID,
    )
