"""Elements of the DCC and of D-SI: texts, quantities and lists of values with uncertainties.

The order of the elements is that of the schemas (DCC 3.3.0, D-SI 2.2.1).
"""

import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_PROBABILITY, Expanded
from stepdiag_ros.report.files import refuse_foreign

VERSION = "3.3.0"
LANGUAGE = "en"
METRE, RADIAN = r"\metre", r"\radian"
_NAMESPACES = {
    "dcc": "https://ptb.de/dcc",
    "si": "https://ptb.de/si",
    "xsi": "http://www.w3.org/2001/XMLSchema-instance",
}
_CERTIFICATE = re.compile(rb"digitalCalibrationCertificate\b[^>]*https://ptb\.de/dcc")
_NOT_IN_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that no XML 1.0 document can hold."""

for _prefix, _uri in _NAMESPACES.items():
    ElementTree.register_namespace(_prefix, _uri)


def _qualified(name: str) -> str:
    prefix, local = name.split(":")
    return f"{{{_NAMESPACES[prefix]}}}{local}"


def element(
    name: str, *content: Element | str | None, ref_type: str = "", **attributes: str
) -> Element:
    """Return an element.

    Args:
        name: with its prefix, such as ``dcc:name``.
        content: its text, or what it contains, in this order; None is left out.
        ref_type: what it means, as names with a prefix; empty: no such attribute.
        attributes: further ones.
    """
    made = Element(_qualified(name), attributes)
    if ref_type:
        made.set("refType", ref_type)
    for one in content:
        if isinstance(one, str):
            # The schema refuses texts that begin or end with blanks.
            made.text = _NOT_IN_XML.sub("\ufffd", " ".join(one.split()))
        elif one is not None:
            made.append(one)
    return made


def optional(name: str, text: str) -> Element | None:
    """Return an element with a text; None where there is no text."""
    return element(name, text) if text else None


def words(name: str, text: str) -> Element:
    """Return an element with a text in English."""
    return element(name, element("dcc:content", text, lang=LANGUAGE))


def proper(name: str, text: str) -> Element:
    """Return an element with a name that is the same in every language."""
    return element(name, element("dcc:content", text))


def real(value: float, unit: str, expanded: Expanded | None = None) -> Element:
    """Return a value with its unit and, where it has one, its expanded uncertainty."""
    uncertainty = None
    if expanded is not None:
        uncertainty = element(
            "si:measurementUncertaintyUnivariate",
            element(
                "si:expandedMU",
                element("si:valueExpandedMU", _number(expanded.value)),
                element("si:coverageFactor", _number(expanded.coverage_factor)),
                element("si:coverageProbability", _number(COVERAGE_PROBABILITY)),
            ),
        )
    return element(
        "si:real", element("si:value", _number(value)), element("si:unit", unit), uncertainty
    )


def reals(
    values: Iterable[float],
    unit: str,
    expanded: Sequence[Expanded] = (),
    labels: Sequence[str] = (),
) -> Element:
    """Return a list of values of one unit.

    Args:
        values: in the unit.
        unit: of all values.
        expanded: of each value; none: they have no uncertainty.
        labels: of each value, without blanks; none: they have no labels.
    """
    uncertainty = None
    if expanded:
        factors = [one.coverage_factor for one in expanded]
        uncertainty = element(
            "si:measurementUncertaintyUnivariateXMLList",
            element(
                "si:expandedMUXMLList",
                element("si:valueExpandedMUXMLList", _numbers(one.value for one in expanded)),
                # One entry stands for all values.
                element("si:coverageFactorXMLList", _numbers(_once(factors))),
                element("si:coverageProbabilityXMLList", _number(COVERAGE_PROBABILITY)),
            ),
        )
    return element(
        "si:realListXMLList",
        element("si:labelXMLList", " ".join(labels)) if labels else None,
        element("si:valueXMLList", _numbers(values)),
        element("si:unitXMLList", unit),
        uncertainty,
    )


def quantity(
    name: str, meaning: str, value: Element, description: str = "", **more: str
) -> Element:
    """Return a quantity.

    Args:
        name: in English.
        meaning: its refType.
        value: of D-SI, or the reason why it is unknown (``no_value``).
        description: in English; empty: none.
        more: further attributes.
    """
    return element(
        "dcc:quantity",
        words("dcc:name", name),
        words("dcc:description", description) if description else None,
        value,
        ref_type=meaning,
        **more,
    )


def no_value(why: str) -> Element:
    """Return what stands in place of a value that is not known."""
    return words("dcc:noQuantity", why)


def document(*rings: Element) -> bytes:
    """Return the whole file."""
    root = element("dcc:digitalCalibrationCertificate", *rings, schemaVersion=VERSION)
    root.set(
        _qualified("xsi:schemaLocation"),
        f"{_NAMESPACES['dcc']} {_NAMESPACES['dcc']}/v{VERSION}/dcc.xsd",
    )
    ElementTree.indent(root)
    return bytes(ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)) + b"\n"


def refuse_unfit(path: Path, others: Iterable[Path] = ()) -> None:
    """Demand that a file to be written replaces nothing but a certificate without a signature.

    Args:
        path: of the certificate.
        others: files that are written with it.

    Raises:
        Refusal: something else is there already, or another file has the same name.
    """
    if path.resolve() in [other.resolve() for other in others]:
        raise Refusal(
            f"{path} is a file of the report as well; name another file by --dcc",
            fault="twice",
            about="--dcc",
            where=str(path),
        )
    refuse_foreign(path, _CERTIFICATE, "digital calibration certificate")
    if path.is_file() and b"http://www.w3.org/2000/09/xmldsig#" in path.read_bytes():
        raise Refusal(
            f"{path} is there already and signed; name another file by --dcc",
            fault="exists",
            about="--dcc",
            where=str(path),
        )


def _number(value: float) -> str:
    # The shortest text that is read back as the same number.
    return repr(float(value))


def _numbers(values: Iterable[float]) -> str:
    return " ".join(map(_number, values))


def _once(values: Sequence[float]) -> Sequence[float]:
    return values[:1] if len(set(values)) == 1 else values
