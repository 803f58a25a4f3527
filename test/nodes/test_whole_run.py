"""A whole measurement on the node graph: recorded, replayed, solved."""

import json
import resource
import subprocess
import sys
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
import yaml
from domains import room_for_a_cell
from patience import PATIENCE
from refused import refused
from running_cell import TWO_LINES

from stepdiag_ros import topics
from stepdiag_ros.bags.reader import BagReader
from stepdiag_ros.bags.recover import recover
from stepdiag_ros.bags.run import load_run
from stepdiag_ros.evaluation.recorded_run import measurement_of
from stepdiag_ros.messages.fields import to_nanoseconds
from stepdiag_ros.metrology.air.recompensation import AirChoice
from stepdiag_ros.metrology.frames import LASER, MACHINE
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.parameters.declaration import COMMON
from stepdiag_ros.parameters.nodes import declared_node
from stepdiag_ros.processes.cell import simulated_cell
from stepdiag_ros.processes.measure import BUSY
from stepdiag_ros.run.sequence import State


def stepdiag(*arguments, timeout=PATIENCE, **options):
    """Run a command; again, where its nodes do not come up since the computer is too busy."""
    with room_for_a_cell() if arguments[0] in ("run", "replay") else nullcontext():
        for _ in range(3):
            done = subprocess.run(
                [sys.executable, "-m", "stepdiag_ros.cli", *map(str, arguments)],
                capture_output=True,
                text=True,
                timeout=timeout,
                **options,
            )
            if BUSY not in done.stderr:
                break
        return done


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """One run of the quick plan, made by the command line, with its JSON result."""
    folder = tmp_path_factory.mktemp("run")
    done = stepdiag(
        "run", "--plan", "quick", "--factor", "20", "--output", folder, "--json",
        "--pictures", "none",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    (bag,) = folder.glob("*.mcap")
    return bag, json.loads(done.stdout)


def test_the_run_gives_a_result_close_to_the_truth(finished):
    _, document = finished
    comparison = document["methods"]["least_squares"]["comparison_with_truth"]
    assert comparison["rms"] < 0.2e-6
    # Without setup errors taken into account it is far off: the run was made with real ones.
    assert document["methods"]["conventional"]["comparison_with_truth"]["rms"] > 1e-6


def test_the_bag_alone_gives_the_same_result_to_the_last_bit(finished, tmp_path):
    bag, document = finished
    done = stepdiag("solve", bag, "--json", "--pictures", "none", "--output", tmp_path)
    assert done.returncode == 0, done.stderr
    again = json.loads(done.stdout)
    assert again["methods"] == document["methods"]
    recorded = load_run(bag)
    last = {result.method: result for result in recorded.results}
    assert set(last) == set(again["methods"]) >= {"conventional", "setup_robust", "least_squares"}
    for method, result in last.items():
        for name, curve in result.curves.items():
            solved = again["methods"][method]["curves"][name]
            assert np.array_equal(curve, np.array(solved, dtype=float), equal_nan=True), name


def test_the_verdict_of_the_run_has_the_uncertainty_that_its_bag_is_solved_with(finished):
    bag, document = finished
    with BagReader(bag) as reader:
        found = [one for _, one in reader.messages(topics=["/" + topics.RUN_VERDICT.name])]
    verdict = found[-1]
    lead = document["lead"]
    assert verdict.run_over and verdict.budgeted and lead["budgeted"]
    assert verdict.worst_error == pytest.approx(lead["largest_in_volume"], rel=1e-9)
    assert verdict.expanded_uncertainty == pytest.approx(lead["expanded_uncertainty"], rel=1e-9)
    assert verdict.expanded_uncertainty >= lead["expanded_uncertainty_of_readings"]


def test_the_air_can_be_compensated_anew_from_the_bag(finished):
    recorded = load_run(finished[0])

    def off(choice):
        made, remark = measurement_of(recorded, False, lambda *_: None, choice)
        pairs = zip(made.lines, recorded.measurement.lines, strict=True)
        by = np.concatenate([np.abs(a.displacement - b.displacement) for a, b in pairs])
        # On a busy computer the first line begins before the recorder hears of the weather.
        known = by[np.isfinite(by)]
        assert len(known) >= len(by) - len(recorded.measurement.lines[0].displacement)
        return known, remark

    # The simulated laser compensates by the same formula, with the dead path of the demo cell. On
    # a busy computer a word of the weather reached it after a reading.
    by, remark = off(AirChoice("own", dead_path=0.3))
    assert np.median(by) < 1e-9 and by.max() < 0.1e-6
    assert "compensated again for the recorded air: equation edlen" in remark
    by, remark = off(AirChoice("off"))
    assert 5e-6 < by.max() < 20e-6 and "not compensated for the air" in remark


def test_a_replay_gives_the_same_bytes_as_the_live_run(finished):
    bag, _ = finished
    done = stepdiag("replay", bag, "--rate", "100", "--check", "--json")
    assert done.returncode == 0, done.stderr + done.stdout
    same = json.loads(done.stdout)["same"]
    assert len(same) == 6 and all(same.values())
    assert same["/result/diagnosis"]


def test_a_replay_of_altered_readings_is_found_different(finished, tmp_path):
    """The check must be able to fail."""
    from stepdiag_ros.bags.writer import BagWriter

    bag, _ = finished
    altered = tmp_path / "altered.mcap"
    with BagReader(bag) as source, BagWriter(altered, source.header) as target:
        for record in source.records():
            data = record.data
            if record.topic.endswith("interferometer/reading"):
                # The compensated displacement, by less than a picometre: of its eight bytes, which
                # stand before 56 others, the third from the end of the mantissa.
                message = bytearray(data)
                message[-62] ^= 1
                data = bytes(message)
            target.write(record.topic, record.type_name, data, record.log_time)
    done = stepdiag("replay", altered, "--rate", "0", "--check")
    assert done.returncode == 1
    assert "DIFFERENT: " in done.stdout and "is the first that differs" in done.stdout


def test_no_reading_is_lost_and_every_stop_has_its_sources(finished):
    recorded = load_run(finished[0])
    sequences = np.array([reading.sequence for reading in recorded.readings()])
    assert len(sequences) > 1000
    assert np.all(np.diff(sequences) == 1)
    assert len(recorded.stops) == recorded.plan.stop_count
    for stop in recorded.stops:
        assert stop.settled, stop.reason
        assert stop.last_sequence - stop.first_sequence + 1 == stop.readings
        assert stop.window_start > stop.in_position_time
        assert 0.0 < stop.standard_uncertainty < 0.1e-6


def test_headers_name_frames_of_the_scene(finished):
    frames = {}
    with BagReader(finished[0]) as bag:
        for record, message in bag.messages():
            if record.topic != topics.DIAGNOSTICS.name:
                frames.setdefault(record.topic.lstrip("/"), set()).add(message.header.frame_id)
    at_the_beam = (
        topics.READING,
        topics.AIR_TEMPERATURE,
        topics.AIR_PRESSURE,
        topics.RELATIVE_HUMIDITY,
    )
    for topic in at_the_beam:
        assert frames.pop(topic.name) == {LASER}
    assert len(frames) > 8 and set().union(*frames.values()) == {MACHINE}


def test_the_bag_says_all_that_made_the_run(finished):
    with BagReader(finished[0]) as bag:
        header = bag.header
    assert header.run_id in finished[0].name
    assert "quick" in header.plan and "chain" in header.machine and "seed" in header.simulated_cell
    recorded = yaml.safe_load(header.parameters)
    needed = ("sequencer", "bridge", "interferometer", "assembler", "solver", "recorder")
    for node in simulated_cell("quick", "demo", "demo", finished[0].parent, 10.0, 0.0, 0):
        if node.name not in needed:
            # On a busy computer a run may begin before the others are up.
            continue
        declared = declared_node(node.name)
        values = recorded[f"/{declared.name}"]
        assert set(values) >= {one.name for one in (*declared.parameters, *COMMON)}
        for name, value in node.parameters.items():
            if isinstance(value, str):
                # A name may be recorded as the file that it stands for.
                assert Path(values[name]).stem == value, name
            elif name != "weather_begins":
                assert values[name] == (str(value) if isinstance(value, Path) else value), name


def test_the_command_line_passes_the_pauses_for_a_setup(tmp_path):
    plan = tmp_path / "plan.yaml"
    plan.write_text(TWO_LINES.replace("pause_for_setup: false", "pause_for_setup: true"))
    done = stepdiag(
        "run", "--plan", plan, "--factor", "20", "--output", tmp_path / "out", "--pictures", "none"
    )
    assert done.returncode == 0, done.stderr
    (bag,) = (tmp_path / "out").glob("*.mcap")
    recorded = load_run(bag)
    assert recorded.plan.pause_for_setup
    assert len(recorded.lines) == len(recorded.plan.lines)


def test_a_full_disk_is_said_and_what_was_recorded_can_be_saved(tmp_path):
    arguments = ("run", "--plan", "quick", "--factor", "20", "--output", tmp_path)
    done = stepdiag(
        *arguments,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (150_000, 150_000)),
    )
    bags = [*tmp_path.glob("*.mcap")]
    assert done.returncode == 1 and len(bags) == 1, done.stderr
    (bag,) = bags
    assert f"{bag}: the disk is full" in done.stderr
    assert BUSY not in done.stderr
    assert "not closed the bag" not in done.stderr
    assert "Traceback" not in done.stderr
    assert recover(bag, tmp_path / "saved.mcap").messages > 100


def test_a_run_refuses_another_one_and_can_be_paused_resumed_and_aborted(make_cell, tmp_path):
    with make_cell(plan="demo") as cell:
        cell.start()
        with refused(Refusal, "rejected"):
            cell.operator.start()
        done = stepdiag("run", "--plan", "quick", "--output", tmp_path / "second")
        assert done.returncode == 1
        assert "another measurement is on ROS domain" in done.stderr
        cell.wait(lambda: len(cell.stops) >= 2, "two stops")
        assert stepdiag("pause").stdout == "pausing after this stop\n"
        cell.wait_for_state(State.PAUSED)
        paused = cell.operator.state
        cell.stands_still_after(paused)
        before = to_nanoseconds(paused.header.stamp)

        def stops_since():
            # On a busy computer those of before the pause come long after it.
            return [s for s in cell.stops if to_nanoseconds(s.header.stamp) > before]

        assert not stops_since()
        assert stepdiag("resume").stdout == "resuming\n"
        cell.wait(lambda: len(stops_since()) > 1, "more stops after resume")
        assert stepdiag("abort").stdout == "aborted\n"
        cell.wait_for_state(State.ABORTED)
        cell.wait(cell.bag_is_closed, "the bag is closed")
        with refused(Refusal, "rejected", "resume", "aborted"):
            cell.operator.call("sequencer/resume")
        done = stepdiag("resume")
        assert done.returncode == 1 and not done.stdout and "aborted" in done.stderr
        cell.stands_still_after(cell.operator.state)
        # And a new run can be started at once.
        cell.start()
        cell.wait(lambda: cell.state() == State.RUNNING, "another run")
