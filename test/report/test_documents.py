"""The JSON of a report against its schema."""

import copy
import json
import math

import jsonschema
import numpy as np
import pytest
from results_by_hand import BLOCKS, make_report, make_result, true_curves, with_unknown

from stepdiag_ros.metrology.geometry import TRANSLATIONS
from stepdiag_ros.report.content import Truth
from stepdiag_ros.report.documents import report_document, report_json, schema


@pytest.fixture(scope="module")
def validator():
    jsonschema.Draft202012Validator.check_schema(schema())
    return jsonschema.Draft202012Validator(schema())


@pytest.mark.parametrize(
    "report",
    [
        make_report(),
        make_report(truth=None, equals_recorded={}, simulated=None, chain="", run_id=""),
        make_report(results=(with_unknown(make_result()),)),
        make_report(results=(), refused={"conventional": "the line npp is missing"}),
    ],
    ids=["whole", "real machine", "one curve unknown", "nothing solved"],
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
    with pytest.raises(ValueError, match="E_ZX has 3 nodes, the result has 4"):
        report_document(make_report(truth=Truth(curves)))


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
