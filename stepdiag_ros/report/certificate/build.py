"""A report as a digital calibration certificate."""

from collections.abc import Iterator, Sequence
from xml.etree.ElementTree import Element

from stepdiag_ros import __version__
from stepdiag_ros.evaluation.report import method_title
from stepdiag_ros.report.certificate.administration import (
    administrative_data,
    identification,
    manufacturer,
    require,
    require_of_run,
    software,
)
from stepdiag_ros.report.certificate.laboratory import Laboratory
from stepdiag_ros.report.certificate.results import budget_of, own, results
from stepdiag_ros.report.certificate.xml import (
    document,
    element,
    optional,
    proper,
    quantity,
    real,
    words,
)
from stepdiag_ros.report.pages.material import Material
from stepdiag_ros.report.pages.sections.measurement import (
    instrument,
    parameters,
    plan_facts,
    temperature_words,
    weather_figures,
)

_CONDITIONS = {
    "air_temperature": ("Air temperature", "basic_temperature", r"\degreecelsius"),
    "material_temperature": ("Temperature of the machine", "", r"\degreecelsius"),
    "air_pressure": ("Air pressure", "", r"\pascal"),
    "relative_humidity": ("Relative humidity of the air", "basic_humidityRelative", r"\one"),
}
"""Field of an environment → name, refType where PTB has one, unit of D-SI."""
_STEP_DIAGONALS = "Ibaraki & Hata 2010, Precision Engineering 34, 516-525"


def certificate(material: Material, stated: Laboratory) -> bytes:
    """Return the file of the certificate, without a signature.

    Args:
        material: what the report is made of.
        stated: by the laboratory.

    Raises:
        Refusal: something that the schema demands is missing (``administration.require``), nothing
            is determined, or an uncertainty is not completely known.
    """
    require(material.given, stated)
    require_of_run(material.recorded, material.given, stated)
    found = element(
        "dcc:measurementResult",
        words("dcc:name", "Geometric errors of a machine tool in its volume"),
        element("dcc:usedMethods", *_methods(material)),
        element("dcc:usedSoftware", *_software(material)),
        element("dcc:measuringEquipments", _equipment(material, stated)),
        element("dcc:influenceConditions", *_conditions(material)),
        results(material),
    )
    return document(administrative_data(material, stated), element("dcc:measurementResults", found))


def _methods(material: Material) -> Iterator[Element]:
    result, budget = budget_of(material)
    facts = {fact.name: fact.text for fact in plan_facts(material)}
    yield _method(
        "Laser measurement along step diagonals and linear axes",
        own("measurement"),
        f"Lines: {facts['Lines']}. Measured box: {facts['Measured box']}."
        f" Evaluation: {method_title(result.method)}."
        f" Temperature of the results: {temperature_words(material)}.",
        ("ISO 230-1:2012",),
        (_STEP_DIAGONALS,),
    )
    yield _method(
        "Expanded uncertainty",
        "basic_uncertainty",
        "Each expanded uncertainty U is the larger of two, for a coverage probability of 95 %: U of"
        " the readings, of plausible rotations of the axes and of the laser's scale; U of all"
        " sources of the uncertainty budget, with its coverage factor from Student's t. Description"
        f" of the instrument: {budget.instrument}. {' '.join(budget.remarks)}",
        ("JCGM 100:2008",),
    )


def _method(
    name: str,
    meaning: str,
    description: str,
    norms: Sequence[str],
    references: Sequence[str] = (),
) -> Element:
    return element(
        "dcc:usedMethod",
        words("dcc:name", name),
        words("dcc:description", description),
        *(element("dcc:norm", norm) for norm in norms),
        *(element("dcc:reference", reference) for reference in references),
        ref_type=meaning,
    )


def _software(material: Material) -> Iterator[Element]:
    yield software("stepdiag_ros: evaluation", __version__)
    if material.recorded.software_version:
        yield software("stepdiag_ros: recording", material.recorded.software_version)


def _equipment(material: Material, stated: Laboratory) -> Element:
    device = stated.instrument
    serial = device.serial or str(parameters(material, "interferometer").get("hardware_id", ""))
    numbers = [
        identification(issuer, value, name)
        for issuer, value, name in (
            ("manufacturer", serial, "Serial number"),
            ("other", device.certificate, "Number of the calibration certificate"),
        )
        if value.strip()
    ]
    return element(
        "dcc:measuringEquipment",
        proper("dcc:name", device.name)
        if device.name
        else words("dcc:name", "Laser interferometer"),
        words("dcc:description", f"{instrument(material)}."),
        manufacturer(device),
        optional("dcc:model", device.model),
        element("dcc:identifications", *numbers) if numbers else None,
        ref_type="basic_normalUsed",
    )


def _conditions(material: Material) -> Iterator[Element]:
    """Yield the weather; a temperature that was not recorded is stated as unknown."""
    figures = weather_figures(material)
    for field, (name, meaning, unit) in _CONDITIONS.items():
        if field not in figures and not field.endswith("temperature"):
            continue
        ref_type = meaning or own(_camel(field))
        if field in figures:
            mean, low, high, _ = figures[field]
            content = [
                quantity(f"{name}, {which}", kind, real(value, unit))
                for which, kind, value in (
                    ("mean", own(f"{_camel(field)}Mean"), mean),
                    ("lowest", f"{ref_type}Min", low),
                    ("highest", f"{ref_type}Max", high),
                )
            ]
        else:
            content = [words("dcc:text", "Unknown: it was not recorded.")]
        yield element(
            "dcc:influenceCondition",
            words("dcc:name", name),
            element("dcc:data", *content),
            ref_type=ref_type,
        )


def _camel(name: str) -> str:
    first, *others = name.split("_")
    return "".join((first, *(one.capitalize() for one in others)))
