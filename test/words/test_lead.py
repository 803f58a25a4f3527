"""The lead: the largest errors by one definition, what was zero, what comes next."""

import io
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from cells_for_tests import make_cell, make_plan
from results_by_hand import BLOCKS, make_report, make_result, true_rotations, with_rotations

from stepdiag_ros.configuration import load_cell, load_plan
from stepdiag_ros.evaluation import lead as leads
from stepdiag_ros.evaluation.budget import NOTHING_STATED, budget_of, with_budget
from stepdiag_ros.evaluation.build import build_report
from stepdiag_ros.evaluation.lead import lead_of
from stepdiag_ros.evaluation.single_errors import expanded_of_curve, single_errors, with_ranges
from stepdiag_ros.metrology.credibility import Misfit
from stepdiag_ros.metrology.discrepancy.summary import Verdict
from stepdiag_ros.metrology.geometry import ROTATIONS, SQUARENESS, TRANSLATIONS
from stepdiag_ros.metrology.plausible import PLAUSIBLE_SCALE, PLAUSIBLE_SHIFT, Plausible
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.solvers import solve
from stepdiag_ros.metrology.solvers.ranges import range_excess
from stepdiag_ros.metrology.solvers.result import Figure
from stepdiag_ros.metrology.standards.volumetric import of_result
from stepdiag_ros.metrology.uncertainty.budget import make_budget
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR, Expanded
from stepdiag_ros.metrology.uncertainty.instrument import Instrument, Spread
from stepdiag_ros.metrology.uncertainty.largest_error import budget_of_largest_error
from stepdiag_ros.plots.files.run import draw_all
from stepdiag_ros.report.documents.lead import lead_document
from stepdiag_ros.report.documents.run import report_json
from stepdiag_ros.report.tables.run import print_report, print_summary
from stepdiag_ros.text.console import make_console
from stepdiag_ros.text.numbers import OF_READINGS, plus_minus, with_expanded, with_uncertainty
from stepdiag_ros.words.lead import (
    coverage_sentences,
    from_here,
    next_lines,
    next_steps,
    sentences_of,
    size_sentences,
)

U_NODE = 5e-8
COMMON = 3e-8
"""Standard uncertainty, m, that all nodes of a curve but the first share."""


def returning(size=4e-6):
    """Return a result whose Z goes to -size and comes back to nothing at the end."""
    there_and_back = np.zeros(BLOCKS + 1)
    there_and_back[1], there_and_back[2] = 0.25 * size, -0.75 * size
    result = make_result()
    values = BLOCKS + 1
    free = np.tile(np.r_[0.0, np.ones(BLOCKS)], len(TRANSLATIONS))
    blocks = np.kron(np.eye(len(TRANSLATIONS)), np.ones((values, values)))
    covariance = np.diag(free * (U_NODE**2 - COMMON**2)) + COMMON**2 * blocks * np.outer(free, free)
    return replace(result, curves={**result.curves, "E_ZZ": there_and_back}, covariance=covariance)


def in_short(report):
    """Return what is said of the sizes; what decides is told by ``test_lead.py``."""
    return size_sentences(lead_of(report))


def named(errors):
    return {one.name: one for one in errors}


def test_positioning_is_peak_to_peak_though_it_ends_at_nothing():
    found = named(single_errors(returning()))["E_ZZ"]
    assert found.value == pytest.approx(4e-6)
    assert found.travel == pytest.approx(0.03 * BLOCKS)
    # What both nodes share leaves their difference. A curve far above its noise has no excess.
    expected = COVERAGE_FACTOR * np.sqrt(2.0 * (U_NODE**2 - COMMON**2))
    assert expected <= found.expanded_uncertainty < 1.01 * expected


def test_a_flat_positioning_error_lies_inside_u_on_a_machine_with_all_other_errors():
    # The largest less the smallest of noisy nodes is too large: 33 % lay inside U without that.
    plan = make_plan(10, step=(0.012,) * 3, repeats=2, directions=("forward", "backward"))
    inside = []
    for seed in range(30):
        rng, scales = np.random.default_rng(seed), {}
        cell = make_cell(seed, high=(0.12,) * 3, positioning=0.0, rotation=3e-6, mirror=20e-6)
        run = simulate(plan, cell, seed)
        lines = []
        for line in run.lines:
            scale = scales.setdefault(line.setup, PLAUSIBLE_SHIFT * rng.standard_normal())
            read = line.displacement * (1.0 + scale) + 1e-7 * rng.standard_normal()
            lines.append(replace(line, displacement=read))
        run = replace(run, lines=tuple(lines), plausible=Plausible(rotation=3e-6))
        result, truth = solve(run), cell.truth(plan.volume)
        certain = replace(result, covariance=np.zeros_like(result.covariance))
        for each in (single_errors(result), single_errors(certain, make_budget(run, Instrument()))):
            errors = named(each)
            inside.append(
                [
                    abs(errors[name].value - np.ptp(truth[name]))
                    < errors[name].expanded_uncertainty
                    for name in ("E_XX", "E_YY", "E_ZZ")
                ]
            )
    of_readings, of_budget = np.mean(np.reshape(inside, (-1, 2, 3)), axis=(0, 2))
    assert of_readings > 0.93 and of_budget > 0.93


def test_straightness_is_the_figure_and_squareness_what_it_makes_over_the_travel():
    result = make_result()
    found = named(single_errors(result))
    straight = result.figure("straightness E_YX")
    assert found["E_YX"].value == straight.value
    assert np.isnan(found["E_YX"].expanded_uncertainty)
    square = result.figure("C0Y")
    assert found["C0Y"].value == pytest.approx(square.value * 0.02 * BLOCKS)
    assert found["C0Y"].expanded_uncertainty == pytest.approx(
        COVERAGE_FACTOR * square.standard_uncertainty * 0.02 * BLOCKS
    )
    turned = replace(result, figures=(Figure("C0Y", -square.value, 2.5e-7, "rad"),))
    assert named(single_errors(turned))["C0Y"].value == found["C0Y"].value


def test_a_curve_with_a_gap_tells_no_range():
    result = returning()
    curve = result.curves["E_ZZ"].copy()
    curve[-1] = np.nan
    gap = replace(result, curves={**result.curves, "E_ZZ": curve})
    assert np.isnan(named(single_errors(gap))["E_ZZ"].value)
    assert "E_ZZ" not in " ".join(in_short(make_report(results=(gap,))))


def _budget(u, factor):
    """Return a budget of node 1 and 2 of E_ZZ, independent, and of C0Y."""
    quantities = (
        SimpleNamespace(name="E_ZZ at 1", curve="E_ZZ", node=1),
        SimpleNamespace(name="E_ZZ at 2", curve="E_ZZ", node=2),
        SimpleNamespace(name="C0Y", curve="", node=-1),
    )
    factors = np.array([1.96, factor, factor])
    return SimpleNamespace(
        sensitivity=SimpleNamespace(quantities=quantities),
        covariance=np.eye(3) * u**2,
        coverage_factor=factors,
        expanded=factors * u,
    )


def test_of_two_uncertainties_the_larger_one_counts():
    result = returning()
    alone = named(single_errors(result))
    wide = named(single_errors(result, _budget(1e-6, 2.5)))
    excess = range_excess(
        result.curves["E_ZZ"], np.diag([0.0, 1.0, 1.0] + [0.0] * (BLOCKS - 2)) * 1e-12
    )
    assert wide["E_ZZ"].expanded_uncertainty == pytest.approx(
        2.5 * np.hypot(np.sqrt(2.0) * 1e-6, excess)
    )
    assert wide["C0Y"].expanded_uncertainty == pytest.approx(2.5e-6 * 0.02 * BLOCKS)
    narrow = named(single_errors(result, _budget(1e-9, 2.5)))
    for name in ("E_ZZ", "C0Y"):
        assert narrow[name].expanded_uncertainty == alone[name].expanded_uncertainty


def test_at_each_node_the_larger_uncertainty_counts_with_its_own_factor():
    result = returning()
    alone = result.standard_uncertainty["E_ZZ"]
    found = expanded_of_curve(result, "E_ZZ", _budget(1e-6, 2.5))
    assert found[1] == Expanded(1.96e-6, 1.96) and found[2] == Expanded(2.5 * 1e-6, 2.5)
    assert found[3] == Expanded(COVERAGE_FACTOR * alone[3], COVERAGE_FACTOR)
    narrow = expanded_of_curve(result, "E_ZZ", _budget(1e-9, 2.5))
    assert narrow == expanded_of_curve(result, "E_ZZ", None)
    assert [one.value for one in narrow] == pytest.approx(list(COVERAGE_FACTOR * alone))


def test_the_largest_come_first_and_three_are_named():
    said = in_short(make_report(results=(returning(),)))
    (largest,) = [text for text in said if "Largest single errors" in text]
    size = plus_minus(4e-6, np.sqrt(2.0 * (U_NODE**2 - COMMON**2)), 1e6)
    first, second, third = largest.split(": ", 1)[1].split("; ")
    travel = 0.03 * BLOCKS * 1e3
    assert first == f"positioning E_ZZ of Z {size} µm over {travel:.0f} mm"
    assert second.startswith("squareness B0Z of Z to X") or second.startswith("squareness A0Z")
    assert third.startswith("squareness")
    assert "peak to peak over the travel" in largest


def test_the_worst_place_is_that_of_the_volume():
    report = make_report(results=(returning(),))
    found = of_result(report.preferred(), report.chain)
    size = plus_minus(found.value, found.standard_uncertainty, 1e6)
    assert f"Largest error in the measured volume: {size} µm" in in_short(report)[0]
    assert f"at X {found.position[0] * 1e3:.1f}" in in_short(report)[0]


def zero_words(*results):
    return [
        text
        for text in in_short(make_report(results=results))
        if "without pitch, yaw and roll" in text
    ]


def test_what_was_taken_as_zero_is_said_and_whether_it_could_be_told():
    result = make_result()
    assert "the measured lines do not determine them" in zero_words(result)[0]
    part = with_rotations(result, unknown=("E_BY",))
    assert zero_words(part, result)[0].endswith("do not determine E_BY.")
    assert "another method determines E_AX, E_BX, E_CX, E_AY, E_CY" in zero_words(part, result)[0]
    whole = with_rotations(result, unknown=())
    assert set(true_rotations()) == set(ROTATIONS)
    assert "another method determines them" in zero_words(whole, result)[0]
    assert not zero_words(whole), "it holds them itself"


@pytest.mark.parametrize("found", Misfit)
def test_errors_that_do_not_explain_the_readings_are_said_to_do_so_before_any_size(
    monkeypatch, found
):
    result = replace(make_result(), degrees_of_freedom=20, chi_squared=20 * 590.0)
    monkeypatch.setattr(leads, "misfit", lambda *_: found)
    lead = lead_of(make_report(results=(result,), bag=Path("run.mcap")))
    assert lead.misfit is found and lead.reduced_chi_squared == pytest.approx(590.0)
    said = sentences_of(lead)
    told = [place for place, text in enumerate(said) if "590.0" in text]
    assert bool(told) == (found is not Misfit.NONE)
    assert told in ([], [len(said) - len(size_sentences(lead)) - 1])
    # Nothing is proposed to be made of errors that something else is in.
    consistent = replace(lead, verdict=Verdict("CONSISTENT", "They agree."))
    proposed = any("compensate" in line for line in next_lines(consistent))
    assert proposed == (found is Misfit.NONE)


@pytest.mark.parametrize("verdict", ["NAMED", "AMBIGUOUS", "DESCRIBED"])
def test_what_the_diagnosis_has_found_is_not_said_to_be_another_effect(verdict):
    lead = lead_of(make_report(results=(make_result(),)))
    found = replace(
        lead,
        misfit=Misfit.SHOWN,
        reduced_chi_squared=590.0,
        verdict=Verdict(verdict, "The model lacks backlash of X.", ("backlash of X",)),
    )
    said = sentences_of(found)
    assert sum("590.0" in text for text in said) == 1
    assert not any("another effect" in text.lower() for text in said)
    unexplained = replace(found, verdict=Verdict("UNEXPLAINED", "The cause is not known."))
    assert any("another effect" in text.lower() for text in sentences_of(unexplained))


def test_rotations_that_every_uncertainty_contains_distort_no_error():
    lead = lead_of(make_report(results=(make_result(),), bag=Path("run.mcap")))
    several = Verdict("NAMED", "The model lacks them.", ("several angular errors",))
    outside, inside = (
        replace(lead, verdict=replace(several, contained=contained)) for contained in (False, True)
    )
    first, second = (" ".join(sentences_of(one)) for one in (outside, inside))
    assert "distorts" in first and "distorts" not in second and "contains rotations" in second
    assert (outside.more_acts, inside.more_acts) == (True, False)
    for one in (outside, inside):
        assert any("plan --for angular" in line for line in next_lines(one))


def test_of_a_run_that_no_method_could_solve_everything_is_unknown():
    lead = lead_of(make_report(results=(), bag=Path("run.mcap")))
    assert lead.solved is False and set(lead.unknown) == {*TRANSLATIONS, *SQUARENESS}
    assert not lead.errors and lead.volume is None
    assert not any("compensate" in line for line in next_lines(lead))


def test_noise_is_no_size_of_an_error(monkeypatch):
    monkeypatch.setattr(leads, "is_noise", lambda _: True)
    said = in_short(make_report(results=(make_result(),)))
    assert len(said) == 2 and said[0].startswith("No error of this machine") and "±" not in said[0]
    assert said[1].startswith("The values are without pitch")


def test_the_last_lines_say_it_in_short_and_what_to_run_next():
    report = make_report(bag=Path("my runs/one.mcap"), refused={"soons": "too little"})
    stream = io.StringIO()
    print_report(report, make_console(stream))
    lines = [line.rstrip() for line in stream.getvalue().splitlines()]
    place = lines.index("In short:")
    lead = lead_of(report)
    assert lines[place + 1 :] == [
        *(*sentences_of(lead), *coverage_sentences(lead), *next_lines(lead))
    ]
    assert any("not solved, too little" in line for line in lines[:place])
    commands = [line.split("  ")[1] for line in lines[-3:]]
    assert commands == [
        "stepdiag diagnose 'my runs/one.mcap'",
        "stepdiag report 'my runs/one.mcap'",
        "stepdiag monitor 'my runs/one.mcap'",
    ]


@pytest.mark.parametrize("width", [40, 80, 200])
def test_a_command_is_one_line_whatever_the_width(width):
    """A command is to be copied, and reasons are to be read."""
    lead = lead_of(make_report(bag=Path("my runs/one.mcap"), refused={"soons": "too little"}))
    commands = [one.command for one in next_steps(lead) if one.command]
    lines = next_lines(lead, width)
    for command in commands:
        (line,) = [line for line in lines if f"{line}  ".startswith(f"  {command}  ")]
        assert width < 200 or line != f"  {command}"
    assert all(len(line) <= width or line.strip() in commands for line in lines)
    words = " ".join(" ".join(lines).split())
    assert all(one.why in words for one in next_steps(lead))


def test_both_quantities_called_positioning_have_tables_of_their_own():
    report = make_report(results=(returning(),))
    stream = io.StringIO()
    print_report(report, make_console(stream))
    text = " ".join(stream.getvalue().split())
    ranges = text[text.index("Positioning error, peak to peak") :]
    size = plus_minus(4e-6, np.sqrt(2.0 * (U_NODE**2 - COMMON**2)), 1e6)
    assert f"E_ZZ of Z µm {size}" in ranges.split("Straightness")[0]
    assert "E_ZZ of Z µm -1.20 ± 0.12" in ranges[ranges.index("at the end of the travel") :]
    truth = with_ranges(report).truth
    assert truth.figures[-1].value == pytest.approx(np.ptp(report.truth.curves["E_ZZ"]))
    assert "positioning-range" not in report_json(report), "results.json is that of the solvers"


def test_the_next_commands_name_the_bag_as_seen_from_here(tmp_path, monkeypatch):
    lead = lead_of(make_report(bag=tmp_path / "deep" / "run.mcap"))
    monkeypatch.chdir(tmp_path)
    assert any(" deep/run.mcap" in line for line in next_lines(lead))
    monkeypatch.chdir("/")
    assert not any(str(tmp_path) in line and f" {tmp_path}" in line for line in next_lines(lead))


@pytest.mark.parametrize(("plan", "repeated"), [("quick", False), ("demo", True)])
def test_a_run_without_repeats_is_said_to_be_one(plan, repeated):
    measurement = simulate(load_plan(plan)[0], load_cell("demo")[0], seed=1)
    lead = lead_of(make_report(measurement=measurement))
    assert lead.repeated is repeated
    consistent = replace(lead, verdict=Verdict("CONSISTENT", "They agree."))
    assert any("No line was repeated" in one for one in sentences_of(consistent)) is not repeated


def test_a_path_is_named_as_seen_from_the_present_folder(tmp_path, monkeypatch):
    here = tmp_path / "here"
    here.mkdir()
    monkeypatch.chdir(here)
    assert from_here(here / "results/a.mcap") == Path("results/a.mcap")
    assert from_here(Path("a.mcap")) == Path("a.mcap")
    # Outside of it a path stays as it was given.
    assert from_here(tmp_path / "b.mcap") == tmp_path / "b.mcap"
    assert from_here(Path("../b.mcap")) == Path("../b.mcap")


def test_what_nothing_has_judged_is_said_with_the_option_that_does():
    lead = lead_of(make_report(results=(returning(),), bag=Path("run.mcap")))
    (step,) = [one for one in next_steps(lead) if one.command.startswith("stepdiag report")]
    assert "--tolerance" in step.why
    # A tolerance is for error curves of lines: refused for a tracker, useless without a volume.
    for other in (replace(lead, tracked=True), replace(lead, volume=None)):
        assert not any("--tolerance" in one.why for one in next_steps(other))


def test_a_lower_bound_of_u_is_named_where_the_largest_error_is():
    lead = replace(lead_of(make_report(results=(returning(),))), budgeted=True)
    for bound in (True, False):
        said = sentences_of(replace(lead, lower_bound=bound))[1]
        assert ("lower bound" in said) == bound and "U of the readings" not in said


def test_the_first_screen_says_which_uncertainty_it_prints():
    lead = lead_of(make_report(results=(returning(),)))
    (said,) = coverage_sentences(lead)
    size = np.hypot(PLAUSIBLE_SCALE, PLAUSIBLE_SHIFT) * 1e6
    # Nobody stated the laser's scale.
    assert f"{size:.2f} µm/m" in said and "assumed" in said and "budget" in said
    assert not lead.budgeted and "U of the readings" in sentences_of(lead)[1]
    assert not coverage_sentences(lead_of(make_report(results=())))
    stream = io.StringIO()
    print_summary(make_report(results=(returning(),)), make_console(stream))
    assert said in stream.getvalue()


@pytest.mark.parametrize("stated", [True, False])
def test_rotations_that_the_readings_show_are_said_beside_what_was_expected(stated):
    expected = replace(lead_of(make_report(results=(returning(),))), budgeted=True)
    expected = replace(expected, rotation_stated=stated, plausible=Plausible(rotation=10e-6))
    (as_expected,) = coverage_sentences(expected)
    (larger,) = coverage_sentences(replace(expected, rotation_shown=19.4e-6))
    assert "10 µrad" in as_expected and "19.4" not in as_expected
    assert "19.4 µrad" in larger and "10 µrad" in larger
    assert ("stated for the machine" in larger) == stated == ("assumed" not in larger)


@pytest.mark.parametrize("corrected", [True, False])
def test_what_a_correction_to_20_degrees_leaves_unstated_is_named(corrected):
    lead = lead_of(make_report(results=(returning(),), bag=Path("run.mcap")))
    lead = replace(lead, budgeted=True, material=corrected)
    (said,) = coverage_sentences(lead)
    assert ("expansion coefficient" in said) == corrected and "laser, air and setup" in said


def test_with_a_budget_the_larger_u_counts_and_what_nobody_stated_is_said():
    measurement = simulate(load_plan("demo")[0], load_cell("demo")[0], seed=1)
    bare = build_report(measurement, chain="YXZ")
    report = with_budget(bare)
    lead, narrow = lead_of(report), lead_of(bare)
    found = of_result(report.preferred(), report.chain, report.plausible)
    by_budget = budget_of_largest_error(report.preferred(), found, report.budget, report.chain)
    assert lead.expanded_uncertainty == by_budget.expanded.value > narrow.expanded_uncertainty
    assert lead.expanded_uncertainty_of_readings == narrow.expanded_uncertainty
    assert lead.budgeted and lead.lower_bound
    unsure = replace(NOTHING_STATED, wavelength=Spread(1e-4))
    wide = lead_of(replace(bare, budget=budget_of(bare, unsure)))
    for one, other, wider in zip(narrow.errors, lead.errors, wide.errors, strict=True):
        assert one.name == other.name == wider.name
        assert one.expanded_uncertainty <= other.expanded_uncertainty
        # Where the laser's scale is unsure by 100 µm/m, positioning is too.
        if one.name in ("E_XX", "E_YY", "E_ZZ"):
            assert wider.expanded_uncertainty > 2.0 * one.expanded_uncertainty
    (said,) = coverage_sentences(lead)
    size = with_uncertainty(0.0, narrow.expanded_uncertainty * 1e6)[1]
    assert OF_READINGS in said and f"{size} µm" in said and "--instrument" in said
    assert "'rotations'" in said
    (stated,) = coverage_sentences(replace(lead, rotation_stated=True))
    assert "'rotations'" not in stated
    document = lead_document(lead)
    assert document["expanded_uncertainty"] == lead.expanded_uncertainty
    assert document["expanded_uncertainty_of_readings"] == narrow.expanded_uncertainty
    assert document["budgeted"] is document["lower_bound"] is True
    heading = draw_all(report)["worst_error"].texts[0].get_text()
    assert with_expanded(found.value, lead.expanded_uncertainty, 1e6) in heading
    assert "lower bound" in heading


def test_rotations_that_no_line_shows_have_the_size_that_the_machine_states():
    lines = simulate(load_plan("quick")[0], load_cell("demo")[0], seed=1)
    far = dict.fromkeys(TRANSLATIONS, np.linspace(0.0, 4e-6, BLOCKS + 1))
    far["E_ZX"] = far["E_ZY"] = far["E_ZZ"] = 2.0 * far["E_XX"]
    report = make_report(results=(replace(returning(), curves=far),), chain="")
    found = [
        lead_of(
            replace(report, measurement=replace(lines, plausible=Plausible(size)))
        ).expanded_uncertainty
        for size in (0.0, 3e-6, 30e-6)
    ]
    assert found[0] < found[1] < found[2]


def test_the_document_of_a_lead_states_where_the_largest_error_is_and_its_bound_elsewhere():
    lead = lead_of(make_report(results=(make_result(),), bag=Path("run.mcap")))
    made = lead_document(replace(lead, expanded_uncertainty=1e-6))
    assert made["largest_at"] == pytest.approx(lead.volume.position)
    assert made["largest_upper_bound"] == pytest.approx(lead.volume.value + 1e-6, rel=1e-12)
    unknown = lead_document(replace(lead, volume=None))
    assert unknown["largest_at"] == [None] * 3 and unknown["largest_upper_bound"] is None


def test_what_has_no_name_is_not_called_an_effect_and_distorts_the_errors_all_the_same():
    lead = lead_of(make_report(results=(make_result(),), bag=Path("run.mcap")))
    unexplained = replace(lead, verdict=Verdict("UNEXPLAINED", "One reading is wrong."))
    said = " ".join(sentences_of(unexplained))
    assert "distorts" in said and "this effect" not in said
