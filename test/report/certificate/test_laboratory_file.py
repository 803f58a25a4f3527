"""The file of a laboratory: what it may state, and what is no such statement."""

from datetime import date

import pytest
from refused import a_fault, refused

from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.report.certificate.laboratory import Laboratory
from stepdiag_ros.text.intake import parse_yaml


def read(text):
    return Laboratory.from_mapping(parse_yaml(text, "lab.yaml"), "lab.yaml")


def test_dates_are_read_with_and_without_quotes_and_texts_without_blanks():
    found = read(
        "certificate: {number: ' 7 ', issued: 2026-11-26, begin: '2026-11-20'}\n"
        "responsible:\n  - {name: A. Turner}\n"
    )
    assert found.certificate.number == "7"
    assert found.certificate.issued == date(2026, 11, 26)
    assert (found.certificate.begin, found.certificate.end) == (date(2026, 11, 20), None)
    assert [one.name for one in found.responsible] == ["A. Turner"]
    assert not found.laboratory.located


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("laboratori: {}", a_fault("unknown", about="laboratori")),
        ("customer: {code: D-K}", a_fault("unknown", about="code")),
        ("laboratory: {postcode: 01067}", a_fault("malformed", about="postcode")),
        ("laboratory: {country: Germany}", a_fault("malformed", "Germany", about="country")),
        ("certificate: {country: de}", a_fault("malformed", "de", about="country")),
        ("certificate: {location: home}", a_fault("unknown", "home", about="location")),
        ("certificate: {issued: soon}", a_fault("malformed", "soon", about="issued")),
        (
            "certificate: {begin: 2026-11-21, end: 2026-11-20}",
            a_fault("out_of_order", "2026-11-20", about="end"),
        ),
        ("responsible: A. Turner", a_fault("malformed", about="responsible")),
        ("- a list", a_fault("malformed")),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_what_is_no_such_statement_is_refused(text, fault):
    with refused(Refusal, fault, "lab.yaml"):
        read(text)
