"""The certificate read back: the numbers of the report, and nothing that the run does not show."""

import copy
import json
import math
import os
import re
import shutil
from dataclasses import replace
from datetime import date
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from dsi_unit import DsiUnit
from lxml import etree
from refused import refused
from report.certificate.read_certificate import (
    ReadCertificate,
    disorder,
    listed,
    positions_of,
    text,
    values_of,
)
from standard_runs import RUN_ID, write_bag

from stepdiag_ros import __version__
from stepdiag_ros.bags.digest import sha256_of
from stepdiag_ros.bags.run import load_run
from stepdiag_ros.cli import main
from stepdiag_ros.commands.solve import report_of
from stepdiag_ros.configuration import load_instrument
from stepdiag_ros.metrology.discrepancy.findings import UNEXPLAINED
from stepdiag_ros.metrology.discrepancy.summary import Verdict
from stepdiag_ros.metrology.geometry import ROTATIONS, SQUARENESS, TRANSLATIONS, moving_axis
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR
from stepdiag_ros.metrology.uncertainty.instrument import Instrument
from stepdiag_ros.report.certificate.administration import require_of_run
from stepdiag_ros.report.certificate.build import certificate
from stepdiag_ros.report.certificate.laboratory import Laboratory
from stepdiag_ros.report.certificate.xml import refuse_unfit
from stepdiag_ros.report.pages import pictures
from stepdiag_ros.report.pages.given import Given
from stepdiag_ros.report.pages.material import Material
from stepdiag_ros.text.intake import parse_yaml

ROOT = Path(__file__).parents[3]
RUN = ROOT / "docs" / "examples" / "small_run.mcap"
PAGE = (ROOT / "docs" / "dcc.md").read_text(encoding="utf-8")
FILE = PAGE.split("```yaml\n")[1].split("```")[0]
"""The file of a laboratory, as the page shows it."""
HEAD = """\
name: part of a run
step_m: [0.03, 0.02, 0.025]
blocks: 3
repeats: 2
directions: [forward, backward]
feed_m_per_s: 0.05
"""
LINES = {
    "whole": "lines:\n  - {kind: linear, names: [x, y, z]}\n"
    "  - {kind: step_diagonal, names: [ppp, npp, pnp, ppn]}\n",
    "one axis": "lines:\n  - {kind: linear, names: [x]}\n",
    "one diagonal": "lines:\n  - {kind: diagonal, names: [ppp]}\n",
}
DEMO = load_instrument("demo")[0]


def stated(text=FILE):
    mapping = parse_yaml(text, "laboratory.yaml")
    # The runs that tests write have no times.
    mapping["certificate"] |= {"begin": date(2026, 1, 2), "end": "2026-01-03"}
    return Laboratory.from_mapping(mapping, "laboratory.yaml")


def given(laboratory=None, **changes):
    known = laboratory or stated()
    return replace(
        Given(
            customer=known.customer.name,
            serial=known.machine.serial,
            instrument=DEMO,
            instrument_source=DEMO.name,
        ),
        **changes,
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return the files that the command makes of a whole run with weather."""
    folder = tmp_path_factory.mktemp("certificate")
    laboratory = folder / "laboratory.yaml"
    laboratory.write_text(FILE, encoding="utf-8")
    made = folder / "made"
    options = ["--instrument", "demo", "--tolerance", "100", "--json", "--output", str(made)]
    options += ["--dcc", str(made / "certificate.xml"), "--laboratory", str(laboratory)]
    assert main(["report", str(RUN), *options]) == 0
    return made


@pytest.fixture(scope="module")
def document(folder):
    return json.loads((folder / "report.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def read(folder):
    return ReadCertificate((folder / "certificate.xml").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def materials(tmp_path_factory):
    folder, made = tmp_path_factory.mktemp("runs"), {}

    def material(name):
        if name not in made:
            path = folder / f"{name.replace(' ', '_')}.mcap"
            write_bag(path, HEAD + LINES[name])
            made[name] = Material(
                load_run(path), report_of(path, with_visibility=True), given(tolerance=1e-3)
            )
        return made[name]

    return material


def changed(material, lead=None, **changes):
    """Return a material of the same evaluation for which something else was given."""
    other = copy.copy(material)
    other.given = replace(material.given, **changes)
    if lead is not None:
        other.__dict__["lead"] = replace(material.lead, **lead)
    return other


def in_xml(made):
    return ReadCertificate(made.decode()), ElementTree.fromstring(made)


@pytest.mark.filterwarnings("ignore::DeprecationWarning:dsi_unit")
@pytest.mark.parametrize("name", ["the command's", "whole", "one axis"])
def test_every_certificate_follows_the_schema(name, folder, materials):
    if name == "the command's":
        made = (folder / "certificate.xml").read_bytes()
    else:
        made = certificate(materials(name), stated())
    root = etree.fromstring(made)
    assert root.get("schemaVersion") == "3.3.0"
    assert list(disorder(root)) == []
    units = {one.text for one in root.iter("{*}unit", "{*}unitXMLList")}
    assert units and all(DsiUnit(unit).valid for unit in units)
    names = {one for element in root.iter() for one in element.get("refType", "").split()}
    assert names and {one.split("_")[0] for one in names} == {"basic", "stepdiag"}
    ids = {element.get("id") for element in root.iter() if element.get("id")}
    assert {element.get("refId") for element in root.iter() if element.get("refId")} == ids
    if schema := os.environ.get("STEPDIAG_DCC_SCHEMA"):
        etree.XMLSchema(etree.parse(schema)).assertValid(root)


@pytest.mark.parametrize("name", ["whole", "one axis"])
def test_every_certificate_follows_the_schematron_rules(name, materials):
    dcclib = pytest.importorskip("dcclib.validation", reason="dcclib is not installed here")
    found = dcclib.SchematronValidator.for_dcc().validate_str(
        certificate(materials(name), stated()).decode()
    )
    errors = [one for one in found.successful_reports if one.role == "error"]
    assert found.is_valid and not errors


def test_a_missing_or_misplaced_element_would_be_found(folder):
    root = etree.fromstring((folder / "certificate.xml").read_bytes())
    core = root.find(".//{*}coreData")
    core.insert(0, core.find("{*}uniqueIdentifier"))
    assert [name for name, _ in disorder(root)] == ["coreData"]
    core.remove(core[0])
    assert [name for name, _ in disorder(root)] == ["coreData"]


def test_the_error_motions_are_those_of_the_report(read, document):
    method = document["sections"]["curves"]["methods"]["least_squares"]
    budget = {one["name"]: one for one in document["sections"]["uncertainty"]["quantities"]}
    for name in TRANSLATIONS:
        values, unit, wide, factors, probabilities = values_of(read.quantities[f"stepdiag_{name}"])
        assert (values, unit) == (method["curves"][name], "\\metre")
        axis = "XYZ"[moving_axis(name)]
        nominal = read.quantities[(f"stepdiag_errorMotionsOf{axis}", "basic_nominalValue")]
        assert positions_of(nominal) == method["nodes"][axis]
        assert set(probabilities) == {document["sections"]["uncertainty"]["coverage_probability"]}
        for node, u in enumerate(method["standard_uncertainty"][name]):
            alone, source = COVERAGE_FACTOR * u, budget.get(f"{name} at {node}")
            if source is not None and source["expanded_uncertainty"] > alone:
                assert wide[node] == source["expanded_uncertainty"]
                assert factors[node] == source["coverage_factor"]
            else:
                assert (wide[node], factors[node]) == (alone, COVERAGE_FACTOR)


def test_single_errors_squareness_and_volume_are_those_of_the_report(read, document):
    summary = document["summary"]
    for one in summary["single_errors"]:
        found = values_of(read.quantities[f"stepdiag_{one['name']}_peakToPeak"])
        expected = ([one["value"]], "\\metre", [one["expanded_uncertainty"]])
        assert found == (*expected, [one["coverage_factor"]], [0.95])
    figures = document["sections"]["curves"]["methods"]["least_squares"]["figures"]
    sizes = {one["name"]: one for one in summary["single_errors"]}
    for name in SQUARENESS:
        value, unit, wide, factor, _ = values_of(read.quantities[f"stepdiag_{name}"])
        assert (value, unit) == ([figures[name]["value"]], "\\radian")
        over_travel = sizes[name]["expanded_uncertainty"]
        assert wide[0] * sizes[name]["travel"] == pytest.approx(over_travel)
        assert factor[0] == sizes[name]["coverage_factor"]
    value, _, wide, factor, _ = values_of(read.quantities["stepdiag_volumetricError"])
    assert (value, wide) == ([summary["value"]], [summary["expanded_uncertainty"]])
    assert factor[0] >= COVERAGE_FACTOR - 1e-4
    place = read.quantities["stepdiag_volumetricErrorPosition"]
    worst = document["sections"]["volume"]["worst"]["methods"]["least_squares"]
    assert positions_of(place) == worst["position"]
    assert text(place["si:realListXMLList"]["si:labelXMLList"]) == "X Y Z"


def test_who_measured_what_for_whom_and_when(read, document):
    core = read.administration["dcc:coreData"]
    assert text(core["dcc:uniqueIdentifier"]) == "2026-0147"
    assert text(core["dcc:performanceLocation"]) == "customer"
    measurement = document["sections"]["measurement"]
    assert text(core["dcc:beginPerformanceDate"]) == measurement["begun"][:10]
    assert text(core["dcc:endPerformanceDate"]) == measurement["last_line_ended"][:10]
    assert measurement["begun"].endswith("+00:00")
    run = {"stepdiag_run": document["run_id"], "stepdiag_recordingSha256": sha256_of(RUN)}
    assert read.identifications() == run
    programs = {
        text(one["dcc:release"])
        for one in listed(read.administration["dcc:dccSoftware"]["dcc:software"])
    }
    assert programs == {f"v{__version__}"}
    item = read.administration["dcc:items"]["dcc:item"]
    (number,) = listed(listed(item)[0]["dcc:identifications"]["dcc:identification"])
    assert text(number["dcc:value"]) == document["sections"]["measurement"]["machine_number"]
    assert "Mill & Sons" in json.dumps(read.administration["dcc:customer"])
    persons = listed(read.administration["dcc:respPersons"]["dcc:respPerson"])
    assert [text(one["dcc:mainSigner"]) for one in persons] == ["true", "false"]
    assert "0815-2026" in json.dumps(read.measurement["dcc:measuringEquipments"])
    assert "stepdiag_simulated" in read.statements()


def test_the_weather_is_that_of_the_report(read, document):
    weather = document["sections"]["measurement"]["weather"]
    kinds = {
        "air_temperature": ("basic_temperature", "\\degreecelsius"),
        "material_temperature": ("stepdiag_materialTemperature", "\\degreecelsius"),
        "air_pressure": ("stepdiag_airPressure", "\\pascal"),
        "relative_humidity": ("basic_humidityRelative", "\\one"),
    }
    assert set(weather) == set(kinds)
    for field, (kind, unit) in kinds.items():
        found = {
            one["@refType"]: one["si:real"]
            for one in listed(read.conditions()[kind]["dcc:quantity"])
        }
        for end, which in (("Min", "lowest"), ("Max", "highest")):
            assert float(text(found[f"{kind}{end}"]["si:value"])) == weather[field][which]
            assert text(found[f"{kind}{end}"]["si:unit"]) == unit


def test_a_run_without_temperature_states_that_it_is_unknown(materials):
    material = copy.copy(materials("whole"))
    unknown = [
        replace(line, environment=np.full_like(line.environment, np.nan))
        for line in material.measurement.lines
    ]
    material.measurement = replace(material.measurement, lines=tuple(unknown))
    read, root = in_xml(certificate(material, stated()))
    assert set(read.conditions()) == {"basic_temperature", "stepdiag_materialTemperature"}
    for data in read.conditions().values():
        assert set(data) == {"dcc:text"}
    assert "\\degreecelsius" not in {one.text for one in root.iter()}
    core = read.administration["dcc:coreData"]
    assert text(core["dcc:beginPerformanceDate"]) == "2026-01-02"
    assert text(core["dcc:endPerformanceDate"]) == "2026-01-03"
    assert read.identifications()["stepdiag_run"] == RUN_ID
    assert "stepdiag_simulated" not in read.statements()


def test_what_is_not_determined_has_no_value(materials):
    material = materials("one axis")
    read, _ = in_xml(certificate(material, stated()))
    unknown = (*material.lead.unknown, *ROTATIONS)
    assert {"E_YY", "E_YX", "C0Y"} <= set(unknown) and "E_XX" not in unknown
    for name in unknown:
        quantity = read.quantities[f"stepdiag_{name}"]
        assert "dcc:noQuantity" in quantity
        assert not [key for key in quantity if key.startswith("si:")]
    values, *_ = values_of(read.quantities["stepdiag_E_XX"])
    assert values == list(material.report.preferred().curves["E_XX"])
    assert "dcc:noQuantity" in read.quantities["stepdiag_volumetricError"]
    assert "basic_conformity" not in read.statements()
    assert "stepdiag_unknown" in read.statements()


def test_a_run_that_determines_nothing_is_refused(materials):
    material = materials("one diagonal")
    with refused(Refusal, "undetermined", about="results", where=str(material.recorded.path)):
        certificate(material, stated())


@pytest.mark.parametrize(
    ("beyond", "more", "status"),
    [
        (2.0, {}, "pass"),
        (-2.0, {}, "fail"),
        (0.5, {}, None),
        (-0.5, {}, None),
        (2.0, {"verdict": Verdict(UNEXPLAINED)}, None),
        (-2.0, {"noise": True}, None),
    ],
    ids=["within", "beyond", "U above the limit", "U below it", "more acts", "noise"],
)
def test_conformity_only_where_iso_14253_1_allows_it(materials, beyond, more, status):
    material = materials("whole")
    value, wide = material.accuracy.value, material.expanded_uncertainty
    assert value > 2.0 * wide
    limit = value + beyond * wide
    read, _ = in_xml(certificate(changed(material, more, tolerance=limit), stated()))
    statement = read.statements()["basic_conformity"]
    assert text(statement["dcc:norm"]) == "ISO 14253-1:2017"
    assert "ISO 14253-1" in json.dumps(statement["dcc:declaration"])
    assert (statement["dcc:conformity"]["#text"] if status else None) == status
    assert status or "dcc:conformity" not in statement
    assert float(text(statement["dcc:data"]["dcc:quantity"]["si:real"]["si:value"])) == limit
    referred = read.quantities["stepdiag_volumetricError"]
    assert statement["@refId"] == referred["@id"]


def test_without_a_tolerance_nothing_is_stated_about_conformity(materials):
    read, _ = in_xml(certificate(changed(materials("whole"), tolerance=math.nan), stated()))
    assert "basic_conformity" not in read.statements()


def test_a_lower_bound_is_not_certified(materials):
    material = changed(materials("whole"), instrument=Instrument("nothing known"))
    for part in ("budget", "expanded", "single_errors"):
        material.__dict__.pop(part, None)
    source = str(material.recorded.path)
    with refused(Refusal, "undetermined", about="expanded uncertainty", where=source):
        certificate(material, stated())


def test_parameters_of_iso_230_2_only_with_a_complete_uncertainty(materials):
    material = materials("whole")
    assert not [
        name for name in in_xml(certificate(material, stated()))[0].quantities if "iso" in name
    ]
    known = changed(material)
    tests = tuple(
        replace(test, expanded_uncertainty=dict.fromkeys(test.parameters, 3e-7))
        for test in material.positioning.tests
    )
    known.__dict__["positioning"] = replace(material.positioning, tests=tests, unknown=())
    read, _ = in_xml(certificate(known, stated()))
    (test,) = [one for one in tests if one.setup == "x"]
    value, unit, wide, factor, _ = values_of(read.quantities["stepdiag_iso230_2_A"])
    found = read.quantities[("stepdiag_iso230_2_x", "stepdiag_iso230_2_A_forward")]
    assert (value, unit, wide, factor) == ([test.parameters["A"]], "\\metre", [3e-7], [2.0])
    assert values_of(found)[0] == [test.parameters["A↑"]]


def test_texts_that_no_xml_can_hold_are_marked_and_not_written(materials):
    material = changed(materials("whole"), customer="Mill\x07 & <Sons>\n ")
    read, _ = in_xml(certificate(material, stated()))
    name = read.administration["dcc:customer"]["dcc:name"]["dcc:content"]
    assert text(listed(name)[0]) == "Mill\ufffd & <Sons>"


def without(key, section):
    """Return the file of the page without one key, or with only the name of a section."""
    mapping = parse_yaml(FILE, "laboratory.yaml")
    mapping["certificate"] |= {"begin": date(2026, 1, 2), "end": date(2026, 1, 3)}
    if key == "city":
        mapping[section] = {"name": mapping[section]["name"]}
    else:
        del mapping[section][key]
    return Laboratory.from_mapping(mapping, "laboratory.yaml")


@pytest.mark.parametrize(
    ("section", "key", "field"),
    [
        ("certificate", "number", "uniqueIdentifier"),
        ("certificate", "country", "countryCodeISO3166_1"),
        ("certificate", "location", "performanceLocation"),
        ("certificate", "begin", "beginPerformanceDate"),
        ("certificate", "end", "endPerformanceDate"),
        ("laboratory", "name", "calibrationLaboratory/contact/name"),
        ("laboratory", "city", "calibrationLaboratory/contact/location"),
        ("customer", "name", "customer/name"),
        ("customer", "city", "customer/location"),
        ("machine", "serial", "items/item/identifications"),
    ],
)
def test_each_key_that_the_schema_demands_is_asked_for(materials, section, key, field):
    laboratory = without(key, section)
    material = changed(
        materials("whole"), customer=laboratory.customer.name, serial=laboratory.machine.serial
    )
    with refused(Refusal, "missing", key, about=field, where="laboratory.yaml"):
        certificate(material, laboratory)


def test_a_certificate_is_not_dated_before_its_measurement(materials):
    laboratory = stated()
    for issued in (None, date(2026, 1, 2), date(2026, 1, 4)):  # one day for time zones
        dated = replace(laboratory, certificate=replace(laboratory.certificate, issued=issued))
        require_of_run(materials("whole").recorded, given(), dated)
    early = replace(laboratory.certificate, issued=date(2026, 1, 1))
    with refused(Refusal, "out_of_order", about="issued", where="laboratory.yaml"):
        certificate(materials("whole"), replace(laboratory, certificate=early))
    run = load_run(RUN)  # its own dates are those that count
    with refused(Refusal, "out_of_order", about="issued"):
        require_of_run(
            run, given(), replace(laboratory, certificate=replace(early, issued=date(2020, 1, 1)))
        )


def test_persons_and_the_name_of_the_machine_are_asked_for(materials):
    material = materials("whole")
    with refused(Refusal, "missing", about="respPersons/respPerson/person/name"):
        certificate(material, replace(stated(), responsible=()))
    nameless = changed(material)
    nameless.recorded = replace(material.recorded, machine_text="chain: YXZ\n")
    unnamed = replace(stated(), machine=replace(stated().machine, name=""))
    with refused(Refusal, "missing", about="items/item/name"):
        certificate(nameless, unnamed)


def test_all_that_is_missing_is_named_at_once_and_before_the_run_is_read(tmp_path, capsys):
    laboratory = tmp_path / "lab.yaml"
    laboratory.write_text("laboratory: {name: L}\nmachine: {serial: '7'}\n", encoding="utf-8")
    broken = tmp_path / "run.mcap"
    broken.write_bytes(b"no recording")
    options = ["--instrument", "demo", "--laboratory", str(laboratory)]
    made = tmp_path / "made" / "certificate.xml"
    assert main(["report", str(broken), *options, "--dcc", str(made)]) == 1
    (said,) = capsys.readouterr().err.splitlines()
    for name in ("uniqueIdentifier", "customer/name", "respPersons", "certificate: number"):
        assert name in said
    assert "lab.yaml" in said and "run.mcap" not in said
    assert sorted(path.name for path in tmp_path.iterdir()) == ["lab.yaml", "run.mcap"]


def test_a_refused_certificate_leaves_no_file_behind(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(pictures.Studio, "fetch_all", lambda _: {})
    laboratory, instrument = tmp_path / "lab.yaml", tmp_path / "instrument.yaml"
    laboratory.write_text(FILE, encoding="utf-8")
    instrument.write_text("name: nothing known\n", encoding="utf-8")
    made = tmp_path / "made"
    options = ["--instrument", str(instrument), "--laboratory", str(laboratory), "--json"]
    options += ["--output", str(made), "--dcc", str(made / "certificate.xml")]
    assert main(["report", str(RUN), *options]) == 1
    assert "laser wavelength" in capsys.readouterr().err
    assert not made.exists() or not list(made.iterdir())


@pytest.mark.parametrize("left_out", ["--laboratory", "--instrument"])
def test_a_certificate_needs_its_two_files(tmp_path, capsys, left_out):
    laboratory = tmp_path / "lab.yaml"
    laboratory.write_text(FILE, encoding="utf-8")
    options = {"--laboratory": str(laboratory), "--instrument": "demo"}
    del options[left_out]
    chosen = [one for pair in options.items() for one in pair]
    assert main(["report", str(RUN), *chosen, "--dcc", str(tmp_path / "c.xml")]) == 1
    assert re.search(rf"{left_out}\b", capsys.readouterr().err)
    assert not (tmp_path / "c.xml").exists()


def test_a_signed_certificate_is_not_overwritten(tmp_path, folder, capsys):
    laboratory, signed = tmp_path / "lab.yaml", tmp_path / "signed.xml"
    laboratory.write_text(FILE, encoding="utf-8")
    root = etree.fromstring((folder / "certificate.xml").read_bytes())
    etree.SubElement(root, "{http://www.w3.org/2000/09/xmldsig#}Signature")
    signed.write_bytes(etree.tostring(root))
    before = signed.read_bytes()
    options = ["--instrument", "demo", "--laboratory", str(laboratory), "--dcc", str(signed)]
    assert main(["report", str(RUN), *options]) == 1
    assert "signed.xml" in capsys.readouterr().err
    assert signed.read_bytes() == before


@pytest.mark.parametrize("name", ["run.mcap", "lab.yaml"])
def test_a_file_that_is_no_certificate_is_not_overwritten(tmp_path, capsys, name):
    shutil.copy(RUN, tmp_path / "run.mcap")
    (tmp_path / "lab.yaml").write_text(FILE, encoding="utf-8")
    before = (tmp_path / name).read_bytes()
    options = ["--instrument", "demo", "--laboratory", str(tmp_path / "lab.yaml"), "--json"]
    target = tmp_path / name
    assert main(["report", str(tmp_path / "run.mcap"), *options, "--dcc", str(target)]) == 1
    assert str(target) in capsys.readouterr().err
    assert target.read_bytes() == before
    assert sorted(path.name for path in tmp_path.iterdir()) == ["lab.yaml", "run.mcap"]


def test_a_certificate_replaces_an_unsigned_one_and_no_file_beside_it(tmp_path, folder):
    refuse_unfit(folder / "certificate.xml", [folder / "report.json"])
    refuse_unfit(tmp_path / "new.xml", [tmp_path / "report.json"])
    with refused(Refusal, "twice", about="--dcc", where=str(tmp_path / "made" / "report.json")):
        refuse_unfit(tmp_path / "made" / "report.json", [tmp_path / "made" / "report.json"])


def test_certificate_and_report_are_not_the_same_file(tmp_path, capsys):
    laboratory, made = tmp_path / "lab.yaml", tmp_path / "made"
    laboratory.write_text(FILE, encoding="utf-8")
    options = ["--instrument", "demo", "--laboratory", str(laboratory), "--json"]
    options += ["--output", str(made), "--dcc", str(made / ".." / "made" / "report.json")]
    assert main(["report", str(RUN), *options]) == 1
    assert "--dcc" in capsys.readouterr().err
    assert not made.exists()
