"""The JSON of a report against its schema."""

import copy
import json
import math

import jsonschema_rs
import numpy as np
import pytest
from refused import refused
from results_by_hand import (
    BLOCKS,
    VOLUME,
    make_report,
    make_result,
    true_curves,
    true_rotations,
    with_rotations,
    with_unknown,
)

from stepdiag_ros.evaluation.report import Truth
from stepdiag_ros.metrology.geometry import CURVES, SQUARENESS, TRANSLATIONS
from stepdiag_ros.metrology.plan import Line, Plan
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.visibility import visibility
from stepdiag_ros.report.documents.run import report_document, report_json
from stepdiag_ros.schemas import schema


@pytest.fixture(scope="module")
def validator():
    jsonschema_rs.meta.validate(schema("result"))
    return jsonschema_rs.Draft202012Validator(schema("result"))


@pytest.mark.parametrize(
    "report",
    [
        make_report(),
        make_report(truth=None, equals_recorded={}, simulated=None, chain="", run_id=""),
        make_report(results=(with_unknown(make_result()),)),
        make_report(results=(with_rotations(make_result()), make_result())),
        make_report(results=(), refused={"conventional": "the line npp is missing"}),
    ],
    ids=["whole", "real machine", "one curve unknown", "rotations", "nothing solved"],
)
def test_every_report_fits_the_schema(report, validator):
    validator.validate(json.loads(report_json(report)))


def test_curves_are_there_to_the_last_bit():
    document = json.loads(report_json(make_report()))
    method = document["methods"]["least_squares"]
    expected = make_result("least_squares", shift=2e-8)
    assert list(method["curves"]) == list(TRANSLATIONS)
    for name in TRANSLATIONS:
        assert method["curves"][name] == list(expected.curves[name])
        assert method["standard_uncertainty"][name] == list(expected.standard_uncertainty[name])
    assert method["nodes"]["Y"] == list(expected.nodes[1])
    assert method["figures"]["B0Z"]["value"] == 1.234567e-5


def test_unknown_is_null_and_not_zero():
    report = make_report(results=(with_unknown(make_result()),), run_id="")
    document = json.loads(report_json(report))
    method = document["methods"]["least_squares"]
    assert method["curves"]["E_YZ"] == [None] * (BLOCKS + 1)
    assert method["figures"]["straightness E_YZ"]["value"] is None
    assert method["figures"]["straightness E_YX"]["standard_uncertainty"] is None
    assert document["run"]["run_id"] is None


def test_comparison_with_truth_counts_rms_and_coverage():
    document = report_document(make_report(results=(make_result(shift=3e-7, uncertainty=2e-7),)))
    found = document["methods"]["least_squares"]["comparison_with_truth"]
    share = BLOCKS / (BLOCKS + 1)
    assert found["rms"] == pytest.approx(3e-7 * math.sqrt(share))
    assert found["largest_deviation"] == pytest.approx(3e-7)
    assert found["points"] == 9 * (BLOCKS + 1)
    assert found["points_with_uncertainty"] == 9 * BLOCKS
    assert found["coverage_95"] == 1.0
    beyond = report_document(make_report(results=(make_result(shift=4e-7, uncertainty=2e-7),)))
    assert beyond["methods"]["least_squares"]["comparison_with_truth"]["coverage_95"] == 0.0


def test_truth_of_another_grid_is_refused():
    curves = {**true_curves(), "E_ZX": np.zeros(BLOCKS)}
    with refused(Refusal, "mismatch", "E_ZX", "3", "4"):
        report_document(make_report(truth=Truth(VOLUME.all_nodes, curves)))


@pytest.mark.parametrize(
    "path",
    [
        ("methods", "least_squares", "curves", "E_XX"),
        ("methods", "least_squares", "frame"),
        ("run",),
        ("squareness_sign",),
    ],
)
def test_the_schema_refuses_a_document_with_a_part_missing(path, validator):
    document = copy.deepcopy(report_document(make_report()))
    part = document
    for key in path[:-1]:
        part = part[key]
    del part[path[-1]]
    assert not validator.is_valid(document)


def test_the_schema_refuses_what_is_no_number_or_not_known(validator):
    document = report_document(make_report())
    document["methods"]["least_squares"]["curves"]["E_XX"][1] = "1e-7"
    assert not validator.is_valid(document)
    document = report_document(make_report())
    document["methods"]["guess"] = document["methods"]["least_squares"]
    assert not validator.is_valid(document)


def test_rotations_are_beside_translations_and_compared_by_themselves():
    truth = Truth(nodes=VOLUME.all_nodes, curves={**true_curves(), **true_rotations()})
    result = with_rotations(make_result("least_squares", shift=1e-7), shift=3e-6)
    method = report_document(make_report(results=(result,), truth=truth))["methods"]["rigid_body"]
    assert list(method["curves"]) == list(CURVES)
    assert method["curves"]["E_BY"] == [0.0] + [None] * BLOCKS
    assert method["comparison_with_truth"]["largest_deviation"] == pytest.approx(1e-7)
    turned = method["comparison_of_rotations"]
    assert turned["largest_deviation"] == pytest.approx(3e-6)
    assert turned["points"] == 8 * (BLOCKS + 1) + 1
    assert turned["points_with_uncertainty"] == 8 * BLOCKS
    assert turned["coverage_95"] == 1.0
    plain = report_document(make_report(results=(result,)))["methods"]["rigid_body"]
    assert plain["comparison_of_rotations"] is None


def test_visibility_is_in_the_document_and_fits_the_schema(validator):
    lines = tuple(Line("linear", name, "", 0, "forward") for name in "xy")
    table = visibility(Plan("two", VOLUME, lines, 0.05), "YXZ", 1e-7)
    document = json.loads(report_json(make_report(visibility=table)))
    validator.validate(document)
    errors = document["visibility"]["errors"]
    assert set(errors) == {*CURVES, *SQUARENESS}
    assert errors["E_XX"]["status"] == "determined"
    assert errors["E_XX"]["standard_uncertainty_at_end"] == pytest.approx(math.sqrt(2) * 1e-7)
    assert errors["E_ZZ"]["status"] == "invisible"
    assert errors["E_ZZ"]["largest_standard_uncertainty"] is None
    assert document["visibility"]["chain"] == "YXZ"
    del document["visibility"]["errors"]["E_XX"]["words"]
    assert not validator.is_valid(document)


def test_the_schema_wants_translations_of_every_method_but_soons(validator):
    document = json.loads(report_json(make_report()))
    del document["methods"]["least_squares"]["curves"]["E_YX"]
    assert not validator.is_valid(document)
