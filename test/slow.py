"""Which tests are slow, and which of them a change concerns.

The quick command leaves them out; most have a small brother there, which takes fewer machines, runs
or moments. A test that takes seconds of processor time belongs here, unless it guards the safety of
the machine or nothing quicker checks the same. ``-m slow`` runs all of them, ``-m slow
--changed-since COMMIT`` those that judge what differs from that commit.
"""

import subprocess
from collections.abc import Iterable
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path, PurePosixPath

import pytest

FIGURES = ("benchmarks", "docs", "evaluation", "metrology", "plots", "report", "words")
"""What figures in documents are computed by, and where they stand."""
EVERY = ("",)
"""For a test that judges every folder."""
CELL = ("bags", "devices", "embedded", "messages", "nodes", "parameters", "processes", "run")
"""What a whole run on nodes goes through."""

SLOW: dict[str, tuple[str, ...]] = {
    "*::many": (),  # machines, runs or moments; "few" of them are quick
    "*::many-*": (),
    "archive/test_catalogue.py::*::s3": (),
    "archive/test_catalogue.py::test_packing_changes_no_row*::[1349]": (),
    "archive/test_catalogue.py::test_small_parts*": (),
    "archive/test_engine.py*": (),
    "archive/test_fleet.py::*::s3": (),
    "archive/test_histories.py::test_the_sealed*": ("archive", "benchmarks", "metrology"),
    "archive/test_rows.py::test_each_figure*": ("report",),
    "archive/test_work.py::*::s3": (),
    "bags/test_table.py::*::effect_[bcdf]": (),
    "bags/test_table_round_trip.py::test_every_run*": (),
    "bands/test_bands.py::*_one_axis_turns_alone::least_squares-E_A[YZ]": ("metrology",),
    "bands/test_bands.py::*_one_axis_turns_alone::least_squares-E_[BC]?": ("metrology",),
    "bands/test_bands.py::*_one_axis_turns_alone::setup_robust*": ("metrology",),
    "bands/test_bands.py::test_no_band_is_too_narrow*": ("metrology",),
    "bands/test_history_bands.py::*::few-setup_robust": ("metrology",),
    "bands/test_wrong_readings.py::*-[1-5]": ("metrology",),
    "blind/test_blind.py::test_a_run_that_cannot_tell*": ("metrology",),
    "blind/test_blind.py::test_every_case*": ("metrology",),
    "blind/test_blind.py::test_few_passes*::[15]*": ("metrology",),
    "blind/test_blind.py::test_no_*": ("metrology",),
    "blind/test_blind.py::test_sizes_are_told*": ("metrology",),
    "by_hand/test_by_hand.py::test_no_stop_is_ever_taken_for_another::*-2": (),
    "campaign/test_fault_campaign.py*": (*CELL, "benchmarks"),
    "commands/test_changes_command.py::test_the_page_is_a_pdf*": ("report",),
    "commands/test_cli_budget.py::test_monte_carlo*": ("metrology",),
    "commands/test_diagnose_command.py::test_a_bag_says_the_same*": ("bags", "metrology"),
    "commands/test_diagnose_command.py::test_several_runs*": ("metrology",),
    "commands/test_diagnose_history.py::test_runs_of_one_week*": ("metrology",),
    "commands/test_first_said.py::test_the_cases_that_are_known::effect_*": (
        "evaluation",
        "metrology",
        "words",
    ),
    "commands/test_iso230_at_20_degrees.py::test_a_report_states*::told1": (
        "evaluation",
        "report",
        "words",
    ),
    "compensation/test_control_text.py::test_a_rewritten_program_does_the_same*": (),
    "compensation/test_learned_effects.py*": ("metrology",),
    "devices/cnc_peers/test_run_on_grbl.py*": CELL,
    "devices/cnc_peers/test_run_on_opcua.py*": CELL,
    "devices/cnc_peers/test_run_on_ros2_control.py*": CELL,
    "devices/test_live_effects.py::*::[123]": ("metrology",),
    "documents/test_document_figures.py::*::candidates": FIGURES,
    "documents/test_document_figures.py::*::named effects": FIGURES,
    "documents/test_document_figures.py::*::seen patterns": FIGURES,
    "documents/test_document_figures.py::*::some candidates": FIGURES,
    "documents/test_example_notebook.py*": FIGURES,
    "evaluation/test_pursuit.py::test_a_run_ends_at_the_first_line*::*-24": ("metrology",),
    "examples/test_behaviour_tree.py::test_a_machine_beyond*": ("compensation",),
    "examples/test_named_effect.py*": ("metrology",),
    "examples/test_outside_control.py::test_the_report*": ("report",),
    "examples/test_outside_effect.py::test_the_tests_of_the_page*": ("metrology",),
    "examples/test_outside_effect.py::test_without_the_package*": ("metrology",),
    "examples/test_outside_method.py::test_a_package_that_is_broken*::no name": (),
    "examples/test_outside_method.py::test_a_package_that_is_broken*::untitled": (),
    "examples/test_outside_method.py::test_nobody_relies*": ("metrology",),
    "examples/test_outside_method.py::test_the_report*": ("report",),
    "examples/test_outside_section.py::test_it_stands_in_its_place*": ("report",),
    "examples/test_supervise.py*": CELL,
    "hostile/test_any_message.py::test_no_exception_leaves_a_node_that_hears_more*": ("nodes",),
    "hostile/test_any_plan.py::test_more_runs_with_odd_plans*": ("nodes",),
    "hostile/test_changed_bags.py::*::many": (
        "bags",
        "commands",
        "evaluation",
        "metrology",
        "report",
    ),
    "hostile/test_changed_bags.py::test_every_chunk_doubled*::older": ("bags",),
    "house/test_archives.py*": EVERY,
    "house/test_benchmarks.py::test_every_benchmark*": EVERY,
    "house/test_house.py::*::mypy": EVERY,
    "linuxcnc/test_closed_loop.py*": (*CELL, "compensation", "metrology"),
    "linuxcnc/test_linuxcnc_measurement.py*": (*CELL, "metrology"),
    "linuxcnc/test_linuxcnc_on_the_fly.py*": ("devices", "metrology"),
    "metrology/test_agreement.py::test_of_an_unchanged_machine*": (),
    "metrology/test_agreement.py::test_rotations_that_stay_the_same*": (),
    "metrology/test_aliases.py::test_a_period_of_whole_steps*": (),
    "metrology/test_aliases.py::test_a_period_that_another*": (),
    "metrology/test_alternative.py::test_its_covariance_is_that_of_repeated*": (),
    "metrology/test_course.py::test_machines_without_change*::[46]-*": (),
    "metrology/test_describe.py::test_a_formula_does_not_invent*::[04]": (),
    "metrology/test_describe.py::test_a_gap_without_a_name*::cooler": (),
    "metrology/test_describe.py::test_a_gap_without_a_name*::creep": (),
    "metrology/test_describe.py::test_a_gap_without_a_name*::drag": (),
    "metrology/test_describe.py::test_a_gap_without_a_name*::jump": (),
    "metrology/test_describe.py::test_a_gap_without_a_name*::swing": (),
    "metrology/test_describe.py::test_a_gap_without_a_name*::turn": (),
    "metrology/test_describe.py::test_a_gap_without_a_name*::warm spot": (),
    "metrology/test_describe.py::test_a_model_learns*": (),
    "metrology/test_describe.py::test_a_name_and_a_formula*": (),
    "metrology/test_describe.py::test_a_slow_change*": (),
    "metrology/test_describe.py::test_the_gap_of_a_shipped_cell*": (),
    "metrology/test_describe.py::test_the_formula_is_the_displacement*": (),
    "metrology/test_describe.py::test_the_shapes_of_a_run_of_days*": (),
    "metrology/test_diagonal_squareness.py::test_rotations_that_no_length*": (),
    "metrology/test_discrepancy.py::test_a_shape_without_a_name*": (),
    "metrology/test_discrepancy.py::test_an_effect_that_the_model_has*::fitted": (),
    "metrology/test_discrepancy.py::test_the_hidden_effect_of_each_case*::effect_[bcdf]": (),
    "metrology/test_discrepancy.py::test_the_hidden_effect_of_each_case*::effect_e": (),
    "metrology/test_discrepancy.py::test_what_the_catalogue_lacks*": (),
    "metrology/test_extra_plan.py::test_a_longer_dwell*": (),
    "metrology/test_extra_plan.py::test_a_turn_that_any_alignment*": (),
    "metrology/test_extra_plan.py::test_ambiguous_then_asked*::angular*": (),
    "metrology/test_extra_plan.py::test_ambiguous_then_asked*::drift*": (),
    "metrology/test_extra_plan.py::test_axes_that_turn*": (),
    "metrology/test_extra_plan.py::test_servo_lag*": (),
    "metrology/test_formula_rivals.py::test_one_more_line*::X": (),
    "metrology/test_history.py::test_each_run_has*": (),
    "metrology/test_history.py::test_what_stays*": (),
    "metrology/test_lack_of_fit.py::test_chances*the_run_itself": (),
    "metrology/test_large_runs.py::test_memory_of_five_thousand_stops*": (),
    "metrology/test_locate.py::test_a_swing*": (),
    "metrology/test_locate.py::test_size_and_share*": (),
    "metrology/test_locate.py::test_the_map_has*": (),
    "metrology/test_locate.py::test_the_words_tell_the_place*::all that its setup*": (),
    "metrology/test_locate.py::test_the_words_tell_the_place*::the Y moves*": (),
    "metrology/test_locate.py::test_the_words_tell_the_place*::the Z moves*": (),
    "metrology/test_locate.py::test_the_words_tell_the_place*::the stops right after*": (),
    "metrology/test_locate.py::test_the_words_tell_the_place_of_the_gap::whole passes*": (),
    "metrology/test_locate.py::test_two_places*": (),
    "metrology/test_loose.py::test_a_drift_stays_a_drift*::3": (),
    "metrology/test_loose.py::test_a_zero_that_scatters*::[123]": (),
    "metrology/test_loose.py::test_an_effect_stands_out*": (),
    "metrology/test_loose.py::test_few_passes_that_scatter*::*-[12]": (),
    "metrology/test_loose.py::test_one_angular_error_stays_one*": (),
    "metrology/test_loose.py::test_several_angular_errors*": (),
    "metrology/test_ranges.py::test_the_shapes_of_angles*": (),
    "metrology/test_rounding.py::test_rounding_is_not_taken_for_an_effect::2e-06": (),
    "metrology/test_rounding.py::test_rounding_is_not_taken_for_an_effect::5e-07": (),
    "metrology/test_setup_errors.py::test_the_uncertainty_of_the_angles_is_that*": (),
    "metrology/test_solvers.py::test_covariance_is_that_of_the_readings*": (),
    "metrology/test_soons.py::test_the_standard_uncertainty_holds*": (),
    "metrology/test_steady.py::test_many_repeats_make_no_effect*::12": (),
    "metrology/test_steady.py::test_many_repeats_make_no_effect*::[34]": (),
    "metrology/test_uncertainty_budget.py::test_a_diagonal_contains*": (),
    "metrology/test_uncertainty_budget.py::test_linear_budget*::conventional": (),
    "metrology/test_uncertainty_budget.py::test_rotations_act_on_the_largest*": (),
    "metrology/test_variants.py::test_a_near_miss*::faster*": (),
    "metrology/test_variants.py::test_a_near_miss*::growing*": (),
    "metrology/test_wrong_reading.py::test_a_few_wrong*::6-[02]": (),
    "metrology/test_wrong_reading.py::test_more_wrong*::1": (),
    "metrology/tracker/test_pass_agreement.py::test_machines_with_every_kind*": (),
    "metrology/tracker/test_tracked_plan.py::test_every_move_of_a_run*": (),
    "metrology/tracker/test_tracker_coverage.py::test_bands_are_not_so_wide*": (),
    "metrology/tracker/test_tracker_coverage.py::test_more_passes*": (),
    "nodes/test_cell_command.py*": (*CELL, "commands"),
    "nodes/test_diagnosis_node.py::test_a_run_goes_on*": CELL,
    "nodes/test_diagonal_run.py*": (*CELL, "metrology"),
    "nodes/test_face_run.py*": (*CELL, "metrology"),
    "nodes/test_fast_stream.py*": CELL,
    "nodes/test_faults.py::test_a_killed_clock*": CELL,
    "nodes/test_faults.py::test_a_killed_node_stops*": CELL,
    "nodes/test_faults.py::test_a_recorder_killed_at_20_random_moments*": CELL,
    "nodes/test_hidden_effects.py*": (*CELL, "metrology"),
    "nodes/test_late_joiners.py*": CELL,
    "nodes/test_learned_effect_live.py*": (*CELL, "compensation", "metrology"),
    "nodes/test_managed_nodes.py::test_a_device_that_is_deactivated*": CELL,
    "nodes/test_measure_action.py::test_a_whole_run*": CELL,
    "nodes/test_measure_action.py::test_runs_by_action*": CELL,
    "nodes/test_measure_action.py::test_the_plan_of*": CELL,
    "nodes/test_on_the_fly_run.py*": (*CELL, "metrology"),
    "nodes/test_recorder_lost.py*": CELL,
    "nodes/test_target_correction_live.py*": (*CELL, "compensation", "metrology"),
    "nodes/test_tracker_run.py*": (*CELL, "metrology"),
    "nodes/test_until.py*": (*CELL, "evaluation"),
    "nodes/test_whole_run.py::test_a_full_disk*": CELL,
    "nodes/test_whole_run.py::test_the_command_line_passes*": (*CELL, "commands"),
    "planning/test_plan_command.py::test_a_wish_that_rests_on_assumed*": ("metrology",),
    "planning/test_plan_command.py::test_a_wish_that_rests_on_nothing*": ("metrology",),
    "planning/test_plan_command.py::test_nothing_is_overwritten*::*.[np]*": (),
    "planning/test_plan_command.py::test_only_the_travel*": ("metrology",),
    "planning/test_plan_on_the_fly.py::test_lines_on_the_fly*": ("metrology",),
    "planning/test_plan_on_the_fly.py::test_rough_time_stamps*": ("metrology",),
    "planning/test_proposal.py::test_angular_errors_need*": ("metrology",),
    "planning/test_proposal.py::test_every_plan_of_the_frontier*::*time_limit*": ("metrology",),
    "planning/test_proposal.py::test_every_purpose*::squareness": ("metrology",),
    "planning/test_proposal.py::test_least_squares_gives_the_uncertainty*::squareness": (
        "metrology",
    ),
    "planning/test_proposal.py::test_the_promise_is*::squareness-YXZ": ("metrology",),
    "planning/test_proposal.py::test_the_promise_is*::straightness-*": ("metrology",),
    "planning/test_proposal.py::test_the_scatter_of_simulated_results*": ("metrology",),
    "planning/test_proposal.py::test_what_cannot_be*::volumetric-wishes[12]*": (),
    "planning/test_reading_table.py::test_a_table_that_is_filled_in*::text0-[ikm]*": ("bags",),
    "planning/test_reading_table.py::test_a_table_that_is_filled_in*::text1-[dik]*": ("bags",),
    "plots/test_diagnosis_and_changes.py::test_a_described_rotation*": ("metrology",),
    "report/pages/test_fleet_page.py*": ("archive",),
    "report/pages/test_history_section.py::test_the_years*": ("archive",),
    "report/pages/test_history_section.py::test_without_an_archive*": (),
    "report/pages/test_report_command.py::test_one_format_alone::pdf": ("plots", "report", "words"),
    "report/pages/test_report_command.py::test_the_pictures_of_the_pdf*": ("plots",),
    "selftest/test_selftest.py::test_a_wrong_sign_in_one_curve_fails::*no*": ("metrology",),
    "selftest/test_selftest.py::test_a_wrong_uncertainty*::0.5": ("metrology",),
    "site/test_site.py*": EVERY,
    "site/test_tutorial.py*": EVERY,
    "viewers/foxglove_live/test_foxglove_live.py*": CELL,
    "viewers/page_live/test_monitor_live.py*": CELL,
    "viewers/terminal/test_watch_command.py::test_a_terminal_that_cannot*": (),
    "viewers/terminal/test_watch_command.py::test_ascii_output*": (),
    "viewers/terminal_live/test_watch_live.py*": CELL,
}
"""Patterns of names of slow tests → folders that each judges, besides its own.

A name is ``folder/module.py::test``, with ``::parameters`` where a test has any. A folder is one in
``stepdiag_ros/`` or ``test/``, or else one in the root, and holds for all that is in it:
``metrology`` for ``stepdiag_ros/metrology/solvers/linear.py`` as well.
"""
SHARED = ("action", "config", "msg")
"""Folders that concern all tests, as do files that are in none."""


def folders_judged(name: str) -> set[str] | None:
    """Return the folders that a slow test judges, by its name as in ``SLOW``; None if quick."""
    found = [
        SLOW[pattern]
        for pattern in _patterns_of(name.partition("::")[0])
        if fnmatchcase(name, pattern)
    ]
    return {name.partition("/")[0]}.union(*found) if found else None


@cache
def _patterns_of(module: str) -> list[str]:
    """Return the patterns that may match tests of a module."""
    return [pattern for pattern in SLOW if fnmatchcase(module, pattern.partition("::")[0])]


def folder_of(path: str) -> str:
    """Return in which folder a file of the repository is, as ``SLOW`` calls it."""
    if path.endswith(".md"):
        return "docs"  # the site takes pages of the root as well
    parts = PurePosixPath(path).parts[:-1]
    return "/".join(parts[1:] if parts[:1] in (("stepdiag_ros",), ("test",)) else parts)


def is_concerned(judged: Iterable[str], changed: Iterable[str]) -> bool:
    """Return whether one of the changed files is in a folder that a test judges, or shared."""
    folders = {folder_of(path) for path in changed}
    if "" in folders:
        return True
    within = (*SHARED, *judged)
    return any(
        not one or f"{folder}/".startswith(f"{one}/") for folder in folders for one in within
    )


def changed_since(commit: str, root: Path) -> list[str] | None:
    """Return which files differ from a commit, from the root; None where git cannot tell."""
    try:
        done = subprocess.run(
            ["git", "diff", "--name-only", commit, "--"],
            cwd=root,
            capture_output=True,
            text=True,
            check=True,
        )
    except (OSError, subprocess.CalledProcessError):
        return None
    return done.stdout.splitlines()


def select(config: pytest.Config, items: list[pytest.Item], root: Path) -> None:
    """Mark slow tests; with ``--changed-since`` leave out those that it does not concern."""
    commit = config.getoption("--changed-since")
    changed = changed_since(commit, root) if commit else None
    left_out = []
    for item in items:
        path = item.path.relative_to(root / "test").as_posix()
        test, _, parameters = item.name.removesuffix("]").partition("[")
        judged = folders_judged("::".join([path, test, *([parameters] if parameters else [])]))
        if judged is None:
            continue
        item.add_marker("slow")
        if changed is not None and not is_concerned(judged, changed):
            left_out.append(item)
    items[:] = [item for item in items if item not in left_out]
    config.hook.pytest_deselected(items=left_out)
