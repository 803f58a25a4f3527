"""The example notebook runs from its first cell to its last, and finds what is in its run."""

from pathlib import Path

import pytest

nbformat = pytest.importorskip("nbformat")
nbclient = pytest.importorskip("nbclient")

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"


@pytest.fixture(scope="module")
def executed():
    notebook = nbformat.read(EXAMPLES / "understand_a_run.ipynb", as_version=4)
    assert all(not cell.outputs for cell in notebook.cells if cell.cell_type == "code")
    probe = (
        "import json\n"
        "from stepdiag_ros.evaluation.report import compare_with_truth\n"
        "found = compare_with_truth(report.preferred(), report.truth)\n"
        "print(json.dumps([run.run_id, found.coverage, found.points_with_uncertainty,\n"
        "    found.rms, worst.value, list(worst.position), bool(np.isnan(errors[1]).all()),\n"
        "    float(np.linalg.norm(errors[0])), diagnosis.diagnosis.verdict,\n"
        "    [[one.label, dict(one.sizes)] for one in diagnosis.findings]]))\n"
    )
    notebook.cells.append(nbformat.v4.new_code_cell(probe))
    client = nbclient.NotebookClient(
        notebook, timeout=300, resources={"metadata": {"path": str(EXAMPLES)}}
    )
    client.execute()
    return notebook


def printed(cell):
    return "".join(one.text for one in cell.outputs if one.output_type == "stream")


def test_every_figure_is_shown(executed):
    drawing = [cell for cell in executed.cells if cell.source.startswith("plots.")]
    drawing += [cell for cell in executed.cells if "\nplots." in cell.source]
    assert len(drawing) >= 7
    for cell in drawing:
        shown = [one for one in cell.outputs if "image/png" in one.get("data", {})]
        assert len(shown) == 1, cell.source


def test_the_errors_of_the_simulated_machine_are_found(executed):
    import json

    from stepdiag_ros.metrology.discrepancy.findings import NAMED

    run_id, coverage, points, rms, worst, place, unknown, length, verdict, found = json.loads(
        printed(executed.cells[-1])
    )
    assert run_id
    # Of so many points fewer than eight in ten inside their 95 % bands would be no chance.
    assert points >= 20 and coverage > 0.8
    assert rms < 1e-6 and 1e-6 < worst < 1e-3
    assert length == pytest.approx(worst)
    assert len(place) == 3 and unknown
    # The cell hides 0.8 µm of lost motion in X.
    assert verdict == NAMED
    assert [label for label, _ in found] == ["backlash of X"]
    assert found[0][1]["lost_motion"] == pytest.approx(0.8e-6, rel=0.1)


def test_it_says_the_worst_place_and_the_verdict(executed):
    said = "".join(printed(cell) for cell in executed.cells[:-1] if cell.cell_type == "code")
    assert "worst place: X " in said and "rms over the volume: " in said
