"""The administrative part of a certificate, and what the schema demands of it."""

from collections.abc import Iterator, Mapping, Sequence
from datetime import date, timedelta
from xml.etree.ElementTree import Element

from stepdiag_ros import __version__
from stepdiag_ros.bags.run import RecordedRun
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.report.certificate.laboratory import Contact, Device, Laboratory, Person
from stepdiag_ros.report.certificate.results import own
from stepdiag_ros.report.certificate.statements import statements
from stepdiag_ros.report.certificate.xml import LANGUAGE, element, optional, proper, words
from stepdiag_ros.report.pages.given import Given
from stepdiag_ros.report.pages.material import Material, with_told
from stepdiag_ros.report.pages.sections.measurement import begun_and_ended

DEFINITIONS = "urn:stepdiag_ros:dcc:1"
"""Of our refTypes."""
_ZONES = timedelta(days=1)
"""A date of the laboratory can be this much before the same day in UTC."""


def performed(recorded: RecordedRun, stated: Laboratory) -> tuple[date | None, date | None]:
    """Return the first and the last day (UTC) of a measurement; of the file where no bag says."""
    begun, ended = begun_and_ended(recorded)
    first = stated.certificate.begin if begun is None else begun.date()
    last = stated.certificate.end if ended is None else ended.date()
    return first, last


def require(given: Given, stated: Laboratory) -> None:
    """Demand all that the schema demands and no recording states.

    Raises:
        Refusal: something is missing; names the elements of the certificate and the keys of the
            file.
    """
    certificate, laboratory, customer = stated.certificate, stated.laboratory, stated.customer
    signs = any(person.name for person in stated.responsible)
    _require(
        stated,
        {
            "uniqueIdentifier": (certificate.number, "certificate: number"),
            "countryCodeISO3166_1": (certificate.country, "certificate: country"),
            "performanceLocation": (certificate.location, "certificate: location"),
            "calibrationLaboratory/contact/name": (laboratory.name, "laboratory: name"),
            "calibrationLaboratory/contact/location": (laboratory.located, "laboratory: city"),
            "respPersons/respPerson/person/name": (signs, "responsible: name"),
            "customer/name": (given.customer, "customer: name"),
            "customer/location": (customer.located, "customer: city"),
        },
    )


def require_of_run(recorded: RecordedRun, given: Given, stated: Laboratory) -> None:
    """Demand what the schema demands and either a recording or the laboratory states.

    Raises:
        Refusal: as ``require``, or the certificate is dated before the end of the measurement.
    """
    first, last = performed(recorded, stated)
    _require(
        stated,
        {
            "items/item/name": (_machine_name(recorded, stated), "machine: name"),
            "items/item/identifications": (with_told(given, recorded).serial, "machine: serial"),
            "beginPerformanceDate": (first, "certificate: begin"),
            "endPerformanceDate": (last, "certificate: end"),
        },
    )
    issued = stated.certificate.issued
    if issued is not None and last is not None and issued < last - _ZONES:
        raise Refusal(
            f"{stated.source}: 'issued' is {issued}, before the end of the measurement, {last}."
            " State the date on which the certificate is issued, or leave it out",
            fault="out_of_order",
            about="issued",
            where=stated.source,
        )


def _require(stated: Laboratory, needed: Mapping[str, tuple[object, str]]) -> None:
    missing = {name: key for name, (value, key) in needed.items() if not value}
    if missing:
        named = ", ".join(f"'{key}' ({name})" for name, key in missing.items())
        raise Refusal(
            f"{stated.source}: a certificate needs {named}; fill in these keys, form: docs/dcc.md",
            fault="missing",
            about=", ".join(missing),
            where=stated.source,
        )


def _machine_name(recorded: RecordedRun, stated: Laboratory) -> str:
    name = recorded.machine.get("name", "")
    return stated.machine.name or (name if isinstance(name, str) else "")


def administrative_data(material: Material, stated: Laboratory) -> Element:
    """Return the administrative part."""
    laboratory = stated.laboratory
    return element(
        "dcc:administrativeData",
        element("dcc:dccSoftware", software("stepdiag_ros", __version__)),
        element("dcc:refTypeDefinitions", _definition()),
        _core_data(material, stated),
        element("dcc:items", _item(material, stated)),
        element(
            "dcc:calibrationLaboratory",
            optional("dcc:calibrationLaboratoryCode", laboratory.code),
            _contact("dcc:contact", laboratory.name, laboratory),
        ),
        element("dcc:respPersons", *_persons(stated.responsible)),
        _contact("dcc:customer", material.given.customer, stated.customer),
        statements(material),
    )


def software(name: str, version: str) -> Element:
    """Return a program with its version."""
    return element(
        "dcc:software",
        proper("dcc:name", name),
        element("dcc:release", f"v{version}"),
        element("dcc:type", "application"),
    )


def _definition() -> Element:
    return element(
        "dcc:refTypeDefinition",
        words("dcc:name", "stepdiag_ros"),
        words(
            "dcc:description",
            "stepdiag_E_XX and alike: error motions and squareness errors by their names in"
            " ISO 230-1. stepdiag_iso230_2_A and alike: parameters of ISO 230-2.",
        ),
        element("dcc:namespace", "stepdiag"),
        element("dcc:link", DEFINITIONS),
    )


def _core_data(material: Material, stated: Laboratory) -> Element:
    recorded, certificate = material.recorded, stated.certificate
    first, last = performed(recorded, stated)
    identities = {
        "Run": ("run", recorded.run_id),
        "SHA-256 of the recording": ("recordingSha256", material.sha256),
    }
    found = [
        identification("calibrationLaboratory", value, name, own(meaning))
        for name, (meaning, value) in identities.items()
        if value
    ]
    return element(
        "dcc:coreData",
        element("dcc:countryCodeISO3166_1", certificate.country),
        element("dcc:usedLangCodeISO639_1", LANGUAGE),
        element("dcc:mandatoryLangCodeISO639_1", LANGUAGE),
        element("dcc:uniqueIdentifier", certificate.number),
        element("dcc:identifications", *found) if found else None,
        element("dcc:beginPerformanceDate", str(first)),
        element("dcc:endPerformanceDate", str(last)),
        element("dcc:performanceLocation", certificate.location),
        element("dcc:issueDate", str(certificate.issued)) if certificate.issued else None,
    )


def identification(issuer: str, value: str, name: str, meaning: str = "") -> Element:
    """Return a number with its name, and who has issued it."""
    return element(
        "dcc:identification",
        element("dcc:issuer", issuer),
        element("dcc:value", value),
        words("dcc:name", name),
        ref_type=meaning,
    )


def _item(material: Material, stated: Laboratory) -> Element:
    machine, report = stated.machine, material.report
    said = ["Machine tool."]
    if report.chain:
        said.append(f"Order of the axes from workpiece to tool: {report.chain}.")
    if report.simulated:
        said.append("The machine is simulated: this is not a calibration.")
    return element(
        "dcc:item",
        proper("dcc:name", _machine_name(material.recorded, stated)),
        words("dcc:description", " ".join(said)),
        manufacturer(machine),
        optional("dcc:model", machine.model),
        element(
            "dcc:identifications",
            identification("manufacturer", material.given.serial, "Serial number"),
        ),
    )


def manufacturer(device: Device) -> Element | None:
    """Return who made a device; None where that is not stated."""
    name = device.manufacturer
    return element("dcc:manufacturer", proper("dcc:name", name)) if name else None


def _persons(persons: Sequence[Person]) -> Iterator[Element]:
    named = [person for person in persons if person.name]
    for number, person in enumerate(named):
        yield element(
            "dcc:respPerson",
            element("dcc:person", proper("dcc:name", person.name)),
            optional("dcc:role", person.role),
            element("dcc:mainSigner", "true" if number == 0 else "false"),
        )


def _contact(name: str, called: str, contact: Contact) -> Element:
    return element(
        name,
        proper("dcc:name", called),
        optional("dcc:eMail", contact.email),
        optional("dcc:phone", contact.phone),
        element(
            "dcc:location",
            optional("dcc:street", contact.street),
            optional("dcc:streetNo", contact.street_number),
            optional("dcc:postCode", contact.postcode),
            optional("dcc:city", contact.city),
            optional("dcc:countryCode", contact.country),
        ),
    )
