"""The file that a laboratory fills in for its reports and certificates: who, for whom, on what.

Every key is optional for a report. A certificate needs those that the schema of the DCC demands.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from datetime import date
from typing import Any, TypeVar

from stepdiag_ros.metrology.checking import Section
from stepdiag_ros.metrology.refusal import Refusal

LOCATIONS = ("laboratory", "customer", "laboratoryBranch", "customerBranch", "other")
"""Where a calibration can be performed, in the words of the DCC."""
_COUNTRY = re.compile(r"[A-Z]{2}")
_Texts = TypeVar("_Texts")


@dataclass(frozen=True)
class Contact:
    """A laboratory or a customer; empty where not stated.

    Attributes:
        name: in words.
        code: of the accreditation; laboratories only.
        email: address.
        phone: number.
        street: without its number.
        street_number: of the house.
        postcode: of the city.
        city: name.
        country: ISO 3166-1, two letters.
    """

    name: str = ""
    code: str = ""
    email: str = ""
    phone: str = ""
    street: str = ""
    street_number: str = ""
    postcode: str = ""
    city: str = ""
    country: str = ""

    @property
    def located(self) -> bool:
        """Say whether anything of the address is stated."""
        return any(
            (self.street, self.street_number, self.postcode, self.city, self.country),
        )


@dataclass(frozen=True)
class Device:
    """The machine or the instrument; empty where not stated.

    Attributes:
        name: in words.
        manufacturer: name.
        model: type designation.
        serial: number by the manufacturer.
        certificate: number of its own calibration certificate; instruments only.
    """

    name: str = ""
    manufacturer: str = ""
    model: str = ""
    serial: str = ""
    certificate: str = ""


@dataclass(frozen=True)
class Person:
    """A person responsible for the certificate.

    Attributes:
        name: of the person.
        role: such as head of the laboratory; empty where not stated.
    """

    name: str = ""
    role: str = ""


@dataclass(frozen=True)
class Certificate:
    """The certificate itself; empty or None where not stated.

    Attributes:
        number: unique.
        country: where it is issued, ISO 3166-1, two letters.
        location: where the calibration was performed, of ``LOCATIONS``.
        issued: date of issue.
        begin: first day of the measurement, for a bag without times.
        end: last day, for a bag without times.
    """

    number: str = ""
    country: str = ""
    location: str = ""
    issued: date | None = None
    begin: date | None = None
    end: date | None = None


@dataclass(frozen=True)
class Laboratory:
    """All that the file states.

    Attributes:
        source: what the user calls the file.
        certificate: number, place and dates.
        laboratory: who measured.
        customer: for whom.
        machine: that was measured.
        instrument: that it was measured with.
        responsible: persons, the first signs.
    """

    source: str = ""
    certificate: Certificate = field(default_factory=Certificate)
    laboratory: Contact = field(default_factory=Contact)
    customer: Contact = field(default_factory=Contact)
    machine: Device = field(default_factory=Device)
    instrument: Device = field(default_factory=Device)
    responsible: tuple[Person, ...] = ()

    @classmethod
    def from_mapping(cls, mapping: Any, source: str) -> "Laboratory":
        """Read the parsed file.

        Args:
            mapping: the parsed YAML.
            source: what the user calls the file.

        Raises:
            Refusal: an unknown key, a value of another type, or a country, place or date that is
                not one; names the file and the key.
        """
        section = Section(mapping, source)
        known = section.keys()
        made = cls(
            source=source,
            certificate=_certificate(section.section("certificate")),
            laboratory=_texts(Contact, section.section("laboratory")),
            customer=_texts(Contact, section.section("customer"), but=("code",)),
            machine=_texts(Device, section.section("machine"), but=("certificate",)),
            instrument=_texts(Device, section.section("instrument")),
            responsible=tuple(_texts(Person, one) for one in section.sections("responsible"))
            if "responsible" in known
            else (),
        )
        section.finish()
        return made


def _texts(kind: type[_Texts], section: Section, but: tuple[str, ...] = ()) -> _Texts:
    """Read a section that consists of texts alone."""
    names = [one.name for one in fields(kind) if one.name not in but]  # type: ignore[arg-type]
    texts = {name: section.text(name, "").strip() for name in names}
    _check_country(section, texts)
    section.finish()
    return kind(**texts)


def _check_country(section: Section, texts: Mapping[str, str]) -> None:
    country = texts.get("country", "")
    if country and not _COUNTRY.fullmatch(country):
        raise Refusal(
            f"{section.source}: 'country' is '{country}'; expected two capital letters of ISO"
            " 3166-1, such as DE",
            fault="malformed",
            about="country",
            where=section.source,
        )


def _certificate(section: Section) -> Certificate:
    texts = {name: section.text(name, "").strip() for name in ("number", "country", "location")}
    _check_country(section, texts)
    if texts["location"]:
        section.names("location", LOCATIONS)
    issued, begin, end = (_date(section, name) for name in ("issued", "begin", "end"))
    section.finish()
    if begin is not None and end is not None and end < begin:
        raise Refusal(
            f"{section.source}: 'end' is {end}, before 'begin', {begin}",
            fault="out_of_order",
            about="end",
            where=section.source,
        )
    return Certificate(**texts, issued=issued, begin=begin, end=end)


def _date(section: Section, key: str) -> date | None:
    value = section.given((key,)).get(key)
    if value is None:
        return None
    try:
        # YAML reads a date as such, unless it stands in quotes.
        return date.fromisoformat(str(value))
    except ValueError:
        raise Refusal(
            f"{section.source}: '{key}' is {str(value)[:60]}; expected a date such as 2026-11-25",
            fault="malformed",
            about=key,
            where=section.source,
        ) from None
