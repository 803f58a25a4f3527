"""What each section of the live page says, against the data that it was told."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from results_by_hand import with_rotations

from stepdiag_ros.evaluation.diagnosing import diagnose_lines
from stepdiag_ros.metrology.air.recompensation import SensorValue
from stepdiag_ros.metrology.geometry import TRANSLATIONS
from stepdiag_ros.metrology.measurement import Environment, Reading
from stepdiag_ros.metrology.standards.volumetric import of_result
from stepdiag_ros.metrology.target import TargetStanding, TargetState
from stepdiag_ros.run.sequence import State as RunState
from stepdiag_ros.text.numbers import plus_minus, time_left
from stepdiag_ros.viewers.page.contact import Contact, SilentNode
from stepdiag_ros.viewers.page.items import AxisPlace, MachineStatus, RunBegin, Said, WorstError
from stepdiag_ros.viewers.page.section import micrometres
from stepdiag_ros.viewers.page.state import SECTIONS, PageState


@pytest.fixture
def state(small_run):
    made = PageState()
    made.take(small_run.begin)
    return made


def reading(**fields):
    told = {
        "time": 0,
        "sequence": 7,
        "raw_displacement": 0.1,
        "compensated_displacement": 0.1234567,
        "signal_strength": 0.824,
        "status": 0,
        "environment": Environment(20.5, 101_325.0, 0.45, math.nan),
    }
    return Reading(**(told | fields))


def test_before_anything_is_known_all_is_said_to_be_unknown():
    state = PageState()
    revision, text = state.update()
    told = json.loads(text)
    assert set(told) == {section.name for section in SECTIONS} and revision == state.revision
    assert told["run"]["words"] == "no run is known yet" and told["run"]["state"] is None
    assert told["beam"]["percent"] == "unknown" and told["beam"]["strength"] is None
    assert [one["text"] for one in told["squareness"]["figures"]] == ["unknown"] * 3
    assert [one["text"] for one in told["weather"]["values"]] == ["unknown"] * 4
    assert told["position"]["texts"] == dict.fromkeys("XYZ", "unknown")
    assert told["curves"]["curves"] == [] and told["verdict"]["verdict"] is None
    assert told["faults"]["faults"] == []


def test_only_what_has_changed_is_told_again(state, small_run):
    known, _ = state.update()
    assert state.update(known) == (known, "{}")
    state.take(AxisPlace(1, (0.01, 0.02, 0.03)))
    later, text = state.update(known)
    assert set(json.loads(text)) == {"position"} and later > known
    # The same again is no news, nor is a heartbeat of the run's state.
    state.take(AxisPlace(2, (0.01, 0.02, 0.03)))
    state.take(small_run.status())
    before = state.revision
    state.take(small_run.status(time=5))
    assert state.revision == before


def test_where_the_run_is(state, small_run):
    index = next(k for k, line in enumerate(small_run.plan.lines) if line.name == "npp")
    state.take(
        small_run.status(line_index=index, stop=5, stop_count=10, stops_done=21, remaining_time=700)
    )
    told = state.document("run")
    assert told["state"] == "RUNNING" and told["words"] == "measuring"
    assert (told["block"], told["block_count"], told["line_number"]) == (2, 3, index + 1)
    assert told["remaining"] == "12 min of machine time"
    assert told["share"] == pytest.approx(21 / small_run.plan.stop_count)
    assert told["plan"] == "a small box" and told["simulated"] is True
    state.take(small_run.status(state=RunState.FINISHED, line_index=len(small_run.plan.lines) - 1))
    assert state.document("run")["remaining"] == ""


def test_an_unknown_time_left_is_not_zero(state, small_run):
    state.take(small_run.status())
    told = state.document("run")
    assert told["remaining"] == "unknown" and told["remaining_s"] is None
    assert [time_left(s) for s in (45.2, 89, 95, 5340, 11_100)] == [
        "45 s",
        "89 s",
        "2 min",
        "89 min",
        "3 h 05 min",
    ]


def test_the_uncertainty_falls_towards_the_target(state, small_run):
    state.take(small_run.status())
    told = state.document("run")
    assert told["target"] == "" and told["target_share"] is None
    shares = []
    for lines, reached in enumerate((math.nan, 2e-6, 1.25e-6, 0.9e-6)):
        over = TargetState.REACHED if lines == 3 else TargetState.OPEN
        one = TargetStanding("E_XX", "m", 1e-6, reached, 8e-7, 100.0, over, lines, "more runs")
        state.take(small_run.status(standing=(one,)))
        told = state.document("run")
        shares.append(told["target_share"])
        assert "1 µm" in told["target"]
    assert shares == [None, 0.5, 0.8, 1.0] and "0.9 µm" in told["target"]
    # The same once more, with another unknown number, is no news.
    beyond = replace(one, time_left=float("nan"))
    state.take(small_run.status(standing=(beyond,)))
    before = state.revision
    state.take(small_run.status(standing=(replace(beyond, time_left=float("nan")),)))
    assert state.revision == before


def test_the_drawing_shows_what_is_left_present_measured_and_incomplete(state, small_run):
    volume = state.document("volume")
    assert volume["box"] == [[10.0, 20.0, 30.0], [40.0, 80.0, 60.0]]
    assert [one["name"] for one in volume["courses"]][3:5] == ["ppp XYZ", "npp XYZ"]
    assert len(volume["courses"][3]["path"]) == 10
    lines = small_run.measurement.lines
    state.take(lines[0])
    state.take(lines[1])
    state.take(replace(lines[2], displacement=np.full_like(lines[2].displacement, np.nan)))
    state.take(small_run.status(line_index=6, stop=2))
    told = state.document("progress")
    looks = [one["look"] for one in told["courses"]]
    assert looks == ["measured", "incomplete", "left", "present", "left", "left", "left"]
    assert told["courses"][0]["done"] == 2
    # The second move of ppp XYZ, from the corner: along Y.
    assert told["block"] == [[20.0, 20.0, 30.0], [20.0, 40.0, 30.0]]
    state.take(small_run.status(state=RunState.FINISHED))
    told = state.document("progress")
    assert told["block"] is None and "present" not in [one["look"] for one in told["courses"]]


def test_the_beam(state):
    state.take(reading())
    told = state.document("beam")
    assert (told["state"], told["percent"], told["reading"]) == ("good", "82 %", "123.45670 mm")
    state.take(reading(status=2, signal_strength=math.nan))
    told = state.document("beam")
    assert told["state"] == "lost" and told["words"] == "the beam is lost"
    assert told["strength"] is None and told["percent"] == "unknown"


def test_a_setup_whose_first_stop_was_not_heard_has_no_zero(state, small_run):
    index = next(k for k, line in enumerate(small_run.plan.lines) if line.name == "ppp")
    stops = small_run.stops(index)
    again = next(
        k
        for k, line in enumerate(small_run.plan.lines)
        if k > index and line.setup == small_run.plan.lines[index].setup
    )
    # Begun to look on in the middle of a line, and at the first stop of a later one.
    for heard in (stops[3:5], small_run.stops(again)[:2]):
        state.take(small_run.begin)
        for stop in heard:
            state.take(stop)
        told = state.document("stop")
        last = told["last"]
        assert last["zero_known"] is False and last["displacement_m"] is None
        words = {last[name] for name in ("displacement", "nominal", "from_nominal", "expected")}
        assert words == {"unknown"} and last["from_expected"] == "unknown"
        assert all(values == [None, None] for _, *values in told["trace"])
    # The next setup is heard from its beginning; its first stop was rejected.
    other = small_run.stops(index + 2)
    assert other[0].command.setup != stops[0].command.setup
    state.take(replace(other[0], settled=False, reason="the beam is lost"))
    state.take(other[1])
    last = state.document("stop")["last"]
    assert last["zero_known"] is True and last["displacement_m"] == 0.0


def test_a_stop_against_a_perfect_machine_and_against_the_model(state, small_run):
    """What the model expects comes within the noise of what was measured; nominal does not."""
    ppp = next(k for k, line in enumerate(small_run.plan.lines) if line.name == "ppp")
    for stop in small_run.stops(ppp)[:3]:
        state.take(stop)
    last = state.document("stop")["last"]
    line = small_run.measurement.lines[ppp]
    assert last["displacement_m"] == pytest.approx(line.displacement[2], abs=1e-12)
    assert last["expected"] == "unknown" and last["from_expected"] == "unknown"
    nominal = sum(block.nominal_displacement for block in small_run.blocks(ppp)[:2])
    off = float(line.displacement[2]) - nominal
    assert last["from_nominal"] == micrometres(off, 1.96 * math.hypot(5e-9, 5e-9))
    # A method that takes the alignment for perfect cannot tell it on a diagonal.
    state.take(small_run.results["conventional"])
    state.take(small_run.stops(ppp)[3])
    assert state.document("stop")["last"]["expected"] == "unknown"
    state.take(small_run.results["least_squares"])
    for stop in small_run.stops(ppp):
        state.take(stop)
    told = state.document("stop")
    assert told["last"]["expected_by"] == "Least squares"
    trace = np.array(told["trace"][4:], dtype=float)
    assert np.max(np.abs(trace[:, 1])) > 5.0 * np.max(np.abs(trace[:, 2]))


def test_a_rejected_stop_is_said_to_be_rejected(state, small_run):
    stop = replace(small_run.stops(0)[0], settled=False, reason="the beam was lost")
    state.take(stop)
    told = state.document("stop")
    assert told["last"]["reason"] == "the beam was lost" and "displacement" not in told["last"]
    assert told["trace"] == [[1, None, None]]


def test_blocks_of_both_directions_lie_at_one_place(state, small_run):
    for block in (*small_run.blocks(0), *small_run.blocks(1)):
        state.take(block)
    told = state.document("blocks")
    assert told["line"] == "x backward, repeat 0" and told["count"] == 6
    assert [one[0] for one in told["before"]] == [0.5, 1.5, 2.5]
    assert [one[0] for one in told["blocks"]] == [2.5, 1.5, 0.5]
    forward, backward = told["before"], told["blocks"][::-1]
    blocks = small_run.blocks(0)
    for shown, block in zip(forward, blocks, strict=True):
        off = (block.displacement - block.nominal_displacement) * 1e6
        assert shown[1] == "X" and shown[2] == pytest.approx(off, rel=1e-5)
    # The same errors of the machine, counted the same way: equal within the noise.
    np.testing.assert_allclose([b[2] for b in backward], [f[2] for f in forward], atol=0.2)
    # Another line has no pass before.
    state.take(small_run.blocks(2)[0])
    assert state.document("blocks")["before"] == []


def test_the_curves_are_those_of_the_result_to_rely_on(state, small_run):
    state.take(small_run.results["conventional"])
    assert state.document("curves")["method"].startswith("Conventional")
    result = small_run.results["least_squares"]
    state.take(result)
    told = state.document("curves")
    assert told["method"] == "Least squares" and told["lines"] == result.lines
    assert [one["name"] for one in told["curves"]] == list(TRANSLATIONS)
    for one in told["curves"]:
        np.testing.assert_allclose(one["values"], result.curves[one["name"]] * 1e6, rtol=1e-5)
        spread = result.standard_uncertainty[one["name"]] * 1.96e6
        np.testing.assert_allclose(one["uncertainty"], spread, rtol=1e-5)
        np.testing.assert_allclose(one["positions"], result.nodes["XYZ".index(one["axis"])] * 1e3)


def test_the_headline_is_the_largest_error_of_the_volume_with_u_and_place(state, small_run):
    assert state.document("worst")["text"] == "unknown"
    result = small_run.results["least_squares"]
    state.take(result)
    told, found = state.document("worst"), of_result(result, small_run.begin.chain)
    assert told["text"] == f"{plus_minus(found.value, found.standard_uncertainty, 1e6)} µm"
    assert told["where"].startswith(f"X {found.position[0] * 1e3:.1f}, Y ")
    assert not told["limit"] and told["curve"] == ""
    # As it comes in a message, without the covariance.
    state.take(replace(result, covariance=np.empty((0, 0))))
    told = state.document("worst")
    assert told["limit"]
    assert told["text"] == f"{plus_minus(found.value, found.uncertainty_limit, 1e6)} µm"
    # The solver has the covariance.
    state.take(WorstError(found.value, 1.96 * 0.25e-6, (0.01, 0.02, 0.03)))
    told = state.document("worst")
    assert told["text"] == f"{plus_minus(found.value, 0.25e-6, 1e6)} µm" and not told["limit"]
    assert told["where"] == "X 10.0, Y 20.0, Z 30.0 mm"
    state.take(WorstError(math.nan, math.nan, 3 * (math.nan,)))
    assert state.document("worst")["limit"]


def test_the_headline_names_the_curve_while_the_volume_is_unknown(state, small_run):
    result = small_run.results["least_squares"]
    known = dict(result.curves, E_ZZ=np.full(4, np.nan))
    state.take(replace(result, curves=known))
    told = state.document("worst")
    largest = max(
        (name for name in TRANSLATIONS if name != "E_ZZ"),
        key=lambda name: np.max(np.abs(result.curves[name])),
    )
    assert told["curve"] == largest
    node = int(np.argmax(np.abs(result.curves[largest])))
    assert told["value"] == pytest.approx(result.curves[largest][node] * 1e6, rel=1e-5)
    place = result.nodes_of(largest)[node] * 1e3
    assert told["where"] == f"{largest[3]} {place:.1f} mm"


def test_a_result_with_rotations_of_an_unknown_machine_has_a_headline_all_the_same(
    state, small_run
):
    state.take(replace(small_run.begin, run_id="another", chain=""))
    turning = with_rotations(small_run.results["least_squares"], unknown=())
    state.take(turning)
    assert state.document("worst")["curve"] in TRANSLATIONS


def test_curves_that_are_not_known_are_null_and_not_zero(state, small_run):
    result = small_run.results["least_squares"]
    unknown = dict(result.curves, E_YX=np.full(4, np.nan))
    state.take(replace(result, curves=unknown, not_determined=("E_YX: …",)))
    told = json.loads(state.update()[1])["curves"]
    curve = next(one for one in told["curves"] if one["name"] == "E_YX")
    assert curve["values"] == [None] * 4 and told["not_determined"] == ["E_YX: …"]
    assert curve["known"] == "none"
    assert {one["known"] for one in told["curves"] if one is not curve} == {"all"}
    # What the frame fixes is no knowledge of the curve.
    ends = np.array([0.0, np.nan, np.nan, 0.0])
    spread = dict(result.standard_uncertainty, E_YX=ends)
    state.take(replace(result, curves=dict(result.curves, E_YX=ends), standard_uncertainty=spread))
    told = state.document("curves")["curves"][1]
    assert told["known"] == "none" and told["worst"] is None
    # Nothing of it is drawn, and it is in no number.
    assert told["values"] == told["uncertainty"] == [None] * 4


def test_squareness_has_its_unit_and_uncertainty(state, small_run):
    result = small_run.results["least_squares"]
    state.take(result)
    shown = {one["name"]: one for one in state.document("squareness")["figures"]}
    assert list(shown) == ["C0Y", "B0Z", "A0Z"]
    for name, one in shown.items():
        assert one["value"] == pytest.approx(result.figure(name).value * 1e6, rel=1e-5)
        assert one["text"].endswith(" µm/m") and "±" in one["text"]


def test_the_verdict(state, small_run):
    summary = diagnose_lines(small_run.measurement, small_run.plan, "name: free\n", 0)
    state.take(summary)
    told = state.document("verdict")
    assert (told["verdict"], told["sentence"]) == (summary.verdict, summary.sentence)
    assert told["gap"]["rms"] == micrometres(summary.before.rms)
    assert told["lines"] == summary.lines


def test_the_air_by_sensors_or_by_the_readings(state):
    state.take(reading())
    texts = {one["name"]: (one["text"], one["source"]) for one in weather(state)}
    assert texts["pressure"] == ("1013.25 hPa", "as compensated")
    assert texts["machine"][0] == "unknown"
    state.take(SensorValue(1, "air_pressure", 99_000.0))
    state.take(reading())
    texts = {one["name"]: (one["text"], one["source"]) for one in weather(state)}
    assert texts["pressure"] == ("990.00 hPa", "sensor")


def weather(state):
    return state.document("weather")["values"]


def test_faults_come_and_go(state, small_run):
    state.take(Said("recorder: disk", 1, "1.5 GB are free"))
    state.take(Said("cnc_bridge: heartbeat", 2, "the controller is silent"))
    state.take(small_run.status(state=RunState.FAULT, text="the beam is lost"))
    told = state.document("faults")["faults"]
    assert [(one["level"], one["who"]) for one in told] == [
        ("fault", "run"),
        ("fault", "cnc_bridge"),
        ("warning", "recorder: disk"),
    ]
    assert told[0]["text"] == "the beam is lost"
    state.take(Said("recorder: disk", 0, "enough is free"))
    state.take(MachineStatus(1, True, "the door is open"))
    # What a node complained of holds no more when it is gone; that it is gone does.
    silent = (SilentNode("/cnc_bridge", "cnc_bridge"),)
    state.take(Contact(True, frozenset({"recorder"}), silent, True, frozenset()))
    state.take(small_run.status())
    texts = [one["text"] for one in state.document("faults")["faults"]]
    assert texts == ["the door is open", "cnc_bridge node /cnc_bridge is silent"]


def test_a_start_is_no_fault_unless_it_lasts(state):
    state.take(Said("laser: beam", 3, "no reading yet", starting=True))
    state.take(Said("laser: heartbeat", 2, "waiting for the clock", starting=True))
    told = state.document("faults")
    assert told["faults"] == []
    assert told["starting"] == [{"who": "laser", "text": "waiting for the clock"}]
    state.take(Said("laser: heartbeat", 0, "ready"))
    assert state.document("faults")["starting"] == [{"who": "laser", "text": "no reading yet"}]
    state.take(Said("laser: beam", 3, "no reading yet"))
    told = state.document("faults")
    assert told["starting"] == []
    assert [(one["level"], one["who"]) for one in told["faults"]] == [("warning", "laser: beam")]


def test_a_device_that_is_waited_for_is_listed_once_with_what_it_keeps_from_work(state):
    why = "cannot open socket://127.0.0.1:9"
    state.take(MachineStatus(1, True, why, faulty=True))
    state.take(Said("cnc_bridge: heartbeat", 2, f"{why}; it will be opened again in 5 s"))
    for task in ("axes", "commands"):
        state.take(Said(f"cnc_bridge: {task}", 1, "the controller is not in use"))
    fault, warning = state.document("faults")["faults"]
    assert fault["level"] == "fault" and why in fault["text"]
    assert warning["level"] == "warning"
    assert all(word in warning["who"] for word in ("cnc_bridge", "axes", "commands"))


def test_a_machine_that_stands_after_an_abort_is_no_fault_unless_it_is_one(state, small_run):
    state.take(MachineStatus(1, True, "stopped on request"))
    assert [one["who"] for one in state.document("faults")["faults"]] == ["machine"]
    state.take(small_run.status(state=RunState.ABORTED))
    assert state.document("faults")["faults"] == []
    state.take(MachineStatus(2, True, "the drive is too hot", faulty=True))
    assert [one["text"] for one in state.document("faults")["faults"]] == ["the drive is too hot"]
    state.take(MachineStatus(3, True, "stopped on request"))
    state.take(small_run.status(state=RunState.FAULT, text="the beam is lost"))
    assert [one["who"] for one in state.document("faults")["faults"]] == ["run", "machine"]


def test_who_only_looked_on_is_missed_by_nobody(state, small_run):
    bystanders = ("scene", "monitor", "foxglove_server", "operator", "player")
    silent = tuple(SilentNode(f"/{one}", one) for one in (*bystanders, "solver"))
    for moment in (None, RunState.IDLE, RunState.RUNNING):
        if moment is not None:
            state.take(small_run.status(state=moment))
        state.take(Contact(True, frozenset({"recorder"}), silent, True, frozenset()))
        texts = [one["text"] for one in state.document("faults")["faults"]]
        assert texts == ["solver node /solver is silent"]


def test_the_last_block_is_counted_forward_as_in_the_chart(state, small_run):
    lines = small_run.plan.lines
    index = next(k for k, one in enumerate(lines) if one.direction == "backward")
    for block in small_run.blocks(index):
        state.take(block)
    told = state.document("blocks")
    off = -(block.displacement - block.nominal_displacement)
    assert told["last"]["displacement_m"] == -block.displacement > 0.0
    assert told["blocks"][-1][2] == pytest.approx(off * 1e6, rel=1e-3)
    assert told["last"]["deviation"] == micrometres(off, 1.96 * block.standard_uncertainty)


def test_a_new_run_begins_with_an_empty_page(state, small_run):
    for stop in small_run.stops(0):
        state.take(stop)
    state.take(small_run.results["least_squares"])
    state.take(reading())
    state.take(RunBegin("another", 1, small_run.plan, "", simulated=False))
    assert state.document("stop") == {"last": None, "trace": []}
    assert state.document("curves")["curves"] == []
    assert state.document("beam")["state"] == "good"


def test_what_comes_before_the_description_of_its_run_is_not_lost(small_run):
    state = PageState()
    state.take(small_run.results["least_squares"], small_run.begin.run_id)
    state.take(small_run.results["conventional"], "of another run")
    assert state.document("curves")["curves"] == []
    state.take(small_run.begin)
    assert state.document("curves")["method"] == "Least squares"


def test_the_page_does_not_grow_with_the_run(state, small_run):
    stops, blocks = small_run.stops(6), small_run.blocks(6)

    def pass_over(count):
        for _ in range(count):
            for stop, block in zip(stops[1:], blocks, strict=True):
                state.take(stop)
                state.take(block)
            state.take(Said("a: b", 1, "something"))
        return len(state.update()[1])

    first = pass_over(60)
    assert abs(pass_over(200) - first) < 0.1 * first
