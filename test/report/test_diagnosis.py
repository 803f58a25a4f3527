"""What is said of a diagnosis, on diagnoses made by hand: every verdict, unit and picture."""

import io
import json
import re
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from stepdiag_ros import schemas
from stepdiag_ros.evaluation.diagnosis import DiagnosisReport, rms_and_largest
from stepdiag_ros.evaluation.not_testable import not_testable_sentences
from stepdiag_ros.metrology.discrepancy.findings import (
    AMBIGUOUS,
    CONSISTENT,
    NAMED,
    NOT_TESTABLE,
    UNEXPLAINED,
    Candidate,
    Diagnosis,
    Finding,
    Loose,
    Pattern,
    RunnerUp,
    Share,
    in_order,
)
from stepdiag_ros.metrology.discrepancy.held_out import HeldOut, Prediction
from stepdiag_ros.metrology.effects.backlash import EFFECT
from stepdiag_ros.metrology.effects.effect import Size
from stepdiag_ros.metrology.effects.stops import stops_of
from stepdiag_ros.metrology.measurement import MeasuredLine, Measurement
from stepdiag_ros.metrology.model import MachineModel
from stepdiag_ros.metrology.plan import Line, Volume
from stepdiag_ros.plots.files.diagnosis import draw_diagnosis
from stepdiag_ros.plots.saving import png_bytes
from stepdiag_ros.report.documents.diagnosis import diagnosis_document, diagnosis_json
from stepdiag_ros.report.pages.diagnosis import diagnosis_page
from stepdiag_ros.report.tables.diagnosis import print_diagnosis, rivals_words
from stepdiag_ros.text.console import make_console
from stepdiag_ros.text.numbers import two_digits
from stepdiag_ros.words.diagnosis import MEANING, chance, readable, size_words
from stepdiag_ros.words.proposal import proposed_sentences

VOLUME = Volume((0.0, 0.0, 0.0), (0.01, 0.01, 0.01), 2)


def _lines():
    lines, time = [], 0.0
    for repeat in (0, 1):
        for direction in ("forward", "backward"):
            line = Line("linear", "x", "", repeat, direction, (0.0, 0.0, 0.0))
            target = line.stops(VOLUME)
            count = len(target)
            lines.append(
                MeasuredLine(
                    line=line,
                    line_index=len(lines),
                    attempt=1,
                    setup="x",
                    time=time + np.arange(count),
                    end_time=0,
                    target=target,
                    displacement=target[:, 0],
                    standard_uncertainty=np.full(count, 1e-7),
                    environment=np.full((count, 4), np.nan),
                )
            )
            time += 10.0
    return tuple(lines)


def _stops():
    return stops_of(Measurement(VOLUME, _lines(), "YXZ"))


FOUND = Finding(
    candidate=Candidate(EFFECT, {"axis": "X"}, "backlash of X"),
    sizes={"lost_motion": 8.123e-7},
    standard_uncertainty={"lost_motion": 1e-8},
    band={"lost_motion": (7.923e-7, 8.323e-7)},
    gain=345.67,
    p_value=1e-30,
    probability=0.97,
    runners_up=(RunnerUp("backlash of <Y>", 12.3, 0.03, "leaves χ² larger by 333"),),
)


def _diagnosis(verdict, findings=(), partial=(), **changes):
    stops = _stops()
    gap = np.linspace(-1e-6, 1e-6, len(stops.time))
    gap[3] = np.nan
    made = Diagnosis(
        verdict=verdict,
        sentence="The sentence.",
        findings=findings,
        partial=partial,
        noise=1e-7,
        noise_degrees_of_freedom=10.0,
        noise_correlation=0.0,
        noise_source="the differences of repeated passes",
        chi_squared_before=500.0,
        chi_squared_after=100.0,
        degrees_of_freedom_before=101,
        degrees_of_freedom_after=100,
        lack_of_fit_p_before=1e-20,
        lack_of_fit_p_after=0.48,
        residual_before=gap,
        residual_after=gap / 10.0,
        detection_limits={"backlash of X": 4.5e-8},
        not_testable={"backlash of Z": "hidden in the curve E_ZZ", "E_BY": "hidden in the tilts"},
        where=("The X moves of x.",),
        stops=stops,
        map=(
            Share("line", "x", 0.0, 5e-7, 6, 1e-9),
            Share("line", "y", 0.0, 1e-7, 6, 0.5),
            Share("pass", "x forward", 0.0, 1e-7, 6, 0.5),
        ),
        tested=3,
    )
    return replace(made, **changes)


def _drawn(report):
    return {name: png_bytes(figure) for name, figure in draw_diagnosis(report).items()}


def _report(diagnosis, **parts):
    return DiagnosisReport(diagnosis, MachineModel(chain="YXZ"), {"backlash": EFFECT}, **parts)


def _text(report):
    stream = io.StringIO()
    print_diagnosis(report, make_console(stream))
    return stream.getvalue()


def test_the_verdict_comes_first_then_where_then_what():
    text = _text(_report(_diagnosis(NAMED, (FOUND,))))
    assert text.startswith("NAMED: The sentence.\n")
    places = [
        text.index(words)
        for words in ("The X moves of x.", "What is missing", "Instead of", "run before")
    ]
    assert places == sorted(places)
    row = next(line for line in text.splitlines() if "0.812 ± 0.020 µm" in line)
    assert "345.7" in row and "< 0.0001" in row and "0.97" in row
    assert "leaves χ² larger by 333" in text
    assert "Noise of a stop: 0.1 µm (10 degrees of freedom" in text


def test_before_and_after_are_side_by_side():
    text = _text(_report(_diagnosis(NAMED, (FOUND,))))
    row = next(line for line in text.splitlines() if "χ² per degree" in line)
    assert row.split()[-2:] == ["4.950", "1.000"]
    row = next(line for line in text.splitlines() if "largest" in line)
    assert row.split()[-2:] == ["1.000", "0.100"]


def test_consistent_says_what_would_have_been_seen_and_shows_no_after():
    text = _text(_report(_diagnosis(CONSISTENT, where=())))
    assert "run after" not in text and "What is missing" not in text
    row = next(line for line in text.splitlines() if line.strip().startswith("backlash of X"))
    assert "0.045" in row and "µm" in row
    assert "backlash of Z: hidden in the curve E_ZZ." in text


def test_ambiguous_names_the_group():
    found = replace(
        FOUND, group=("sag of XY",), runners_up=(replace(FOUND.runners_up[0], ambiguous=True),)
    )
    text = _text(_report(_diagnosis(AMBIGUOUS, (found,))))
    assert "'backlash of X' cannot be distinguished from 'sag of XY' and 'backlash of <Y>'" in text
    assert "NOT RULED OUT" in text


def test_what_closes_only_a_part_is_not_called_found():
    text = _text(_report(_diagnosis(UNEXPLAINED, (), (FOUND,), where_after=("Still in x.",))))
    assert "not to be believed alone" in text and "What is missing" not in text
    assert "Still in x." in text


def test_not_testable_has_unknown_figures_and_no_false_ones():
    nan = float("nan")
    report = _report(
        _diagnosis(
            NOT_TESTABLE,
            noise=nan,
            chi_squared_before=nan,
            chi_squared_after=nan,
            lack_of_fit_p_before=nan,
            lack_of_fit_p_after=nan,
            detection_limits={},
            map=(),
        )
    )
    text = _text(report)
    assert "Noise of a stop: unknown" in text
    assert "nan" not in text
    document = json.loads(diagnosis_json(report))
    assert document["noise"]["standard_deviation_m"] is None
    assert document["before"]["chi_squared"] is None
    assert "gap_where" not in draw_diagnosis(report)


def test_json_is_si_and_unknown_is_null():
    document = diagnosis_document(_report(_diagnosis(NAMED, (FOUND,)), sha256="ab", run_id="r"))
    assert json.loads(json.dumps(document, allow_nan=False)) == document
    (finding,) = document["findings"]
    assert finding["effect"] == "backlash" and finding["setting"] == {"axis": "X"}
    assert finding["sizes"][0]["value"] == 8.123e-7
    assert finding["sizes"][0]["band_95"] == [7.923e-7, 8.323e-7]
    assert document["gap"]["before_m"][3] is None
    assert document["gap"]["stops"][3]["direction"] == "backward"
    assert len(document["gap"]["before_m"]) == len(document["gap"]["stops"]) == 12
    assert document["held_out"] is None


def _proof():
    gap = np.full(12, np.nan)
    gap[6:] = 1e-7
    return HeldOut(
        split="the last repeat",
        labels=("backlash of X",),
        independent=True,
        training_verdict=NAMED,
        readings=6,
        before=Prediction(60.0, 6, 1e-9, 10.0 * gap),
        after=Prediction(5.4, 6, 0.5, gap),
        gain=43.21,
        gain_p_value=3e-12,
    )


def test_the_proof_is_told_and_drawn():
    report = _report(_diagnosis(NAMED, (FOUND,)), held_out=_proof())
    text = _text(report)
    assert "Held out: the last repeat (6 stops)" in text
    assert "to χ²/dof 0.900, without it to 10.000" in text
    assert diagnosis_document(report)["held_out"]["after"]["rms_m"] == pytest.approx(1e-7)
    assert "held_out" in draw_diagnosis(report)


def test_what_the_effect_itself_explains_of_the_held_out_readings_is_told_everywhere():
    report = _report(_diagnosis(NAMED, (FOUND,)), held_out=_proof())
    assert "Δχ² = 43.2 (p < 0.0001)" in " ".join(_text(report).split())
    page = diagnosis_page(report, {})
    assert "Δχ² = 43.2 (p &lt; 0.0001)" in page
    head = page[page.index("<header>") : page.index("</header>")]
    assert "<dt>the effect itself, held out</dt><dd>Δχ² 43.2, p &lt; 0.0001</dd>" in head
    document = diagnosis_document(report)
    assert document["held_out"]["gain"] == {"chi_squared": 43.21, "p_value": 3e-12}
    unknown = replace(report, held_out=replace(_proof(), gain=0.0, gain_p_value=float("nan")))
    assert "(p unknown)" in " ".join(_text(unknown).split())
    assert diagnosis_document(unknown)["held_out"]["gain"]["p_value"] is None


def test_a_zero_that_scatters_from_pass_to_pass_is_told_beside_the_noise():
    calm, wandering = _diagnosis(CONSISTENT), _diagnosis(CONSISTENT, loose=Loose(zero=1.23e-7))
    said = "the zero scatters from pass to pass by 0.12 µm"
    for diagnosis, told in ((calm, False), (wandering, True)):
        report = _report(diagnosis)
        assert (said in " ".join(_text(report).split())) == told
        assert (said in diagnosis_page(report, {})) == told
        document = json.loads(diagnosis_json(report))
        assert document["schema"] == schemas.identifier("diagnosis")
        assert document["noise"]["zero_scatter_m"] == (1.23e-7 if told else 0.0)
    # What no repeat shows is not zero.
    once = stops_of(Measurement(VOLUME, _lines()[:1], "YXZ"))
    gap = np.zeros(len(once.time))
    alone = replace(calm, stops=once, residual_before=gap, residual_after=gap)
    assert diagnosis_document(_report(alone))["noise"]["zero_scatter_m"] is None


def test_a_name_that_is_not_independent_is_said_so():
    proof = replace(_proof(), independent=False, training_verdict=AMBIGUOUS)
    assert "alone are AMBIGUOUS, so that only the sizes are theirs" in proof.sentence


def test_the_page_stands_alone_and_is_safe():
    report = _report(_diagnosis(NAMED, (FOUND,)), held_out=_proof(), run_id="<script>")
    page = diagnosis_page(report, _drawn(report))
    assert page.count('src="data:image/png;base64,') == 5 == page.count("<img")
    for outside in ("http:", "https:", "<script", "<link", "@import", "url("):
        assert outside not in page
    assert "backlash of &lt;Y&gt;" in page
    titles = ("Before", "Where it is", "Candidates ranked", "After", "Where this comes from")
    places = [page.index(title) for title in titles]
    assert places == sorted(places)
    body = page[page.index("<body>") : page.index("</body>") + len("</body>")]
    body = body.replace("<br>", "<br/>")
    ElementTree.fromstring(re.sub(r"(<img [^>]*)>", r"\1/>", body))


def test_every_picture_of_a_named_effect_is_drawn():
    drawn = draw_diagnosis(_report(_diagnosis(NAMED, (FOUND,))))
    assert set(drawn) == {"gap_map", "gap_where", "candidates", "gap_traces"}
    before, after = [axes for axes in drawn["gap_map"].axes if axes.get_title()]
    assert before.get_title().startswith("before: rms 0.") and "largest 1.00" in before.get_title()
    # One scale of colours for both, or the eye is misled.
    assert before.collections[0].get_clim() == after.collections[0].get_clim()
    shown = before.collections[0].get_array()
    assert shown.shape == (4, 3)
    assert shown[0, 0] == pytest.approx(-1.0) and np.ma.getmaskarray(shown)[1, 0]


class _Slip(type(EFFECT)):
    name = "slip"

    def settings(self, stops):
        del stops
        for stop in range(9):
            yield {"stop": stop}


def test_many_settings_of_one_effect_are_one_row():
    slip = _Slip()
    limits = {slip.label({"stop": stop}): (1 + stop) * 1e-8 for stop in range(9)}
    report = DiagnosisReport(
        _diagnosis(CONSISTENT, detection_limits=limits), MachineModel(), {"slip": slip}
    )
    row = next(line for line in _text(report).splitlines() if "slip" in line)
    assert "slip (9 settings)" in row and "0.01 .. 0.09" in row


def test_reasons_are_said_once_and_many_settings_are_counted():
    hidden = {"E_BY": "needs a repeat", "backlash of Z": "needs a repeat"}
    hidden["one"] = "only a step beyond 1.5e-07 m would be seen, too large (2e-06 m)"
    hidden["two"] = "only a step beyond 3e-07 m would be seen, too large (2e-06 m)"
    report = _report(_diagnosis(CONSISTENT, not_testable=hidden))
    assert not_testable_sentences(report) == [
        "E_BY, backlash of Z: needs a repeat.",
        "one, two: only a step beyond 0.15 .. 0.3 µm would be seen, too large (2 µm).",
    ]
    slip = _Slip()
    labels = {slip.label({"stop": stop}): "needs a repeat" for stop in range(9)}
    report = replace(
        _report(_diagnosis(CONSISTENT, not_testable={"E_BY": "needs a repeat", **labels})),
        catalogue={"slip": slip},
    )
    assert not_testable_sentences(report) == ["E_BY, slip (9 settings): needs a repeat."]


@pytest.mark.parametrize(
    ("unit", "high", "shown", "factor"),
    [
        ("m", 1e-6, "µm", 1e6),
        ("rad", 1e-6, "µrad", 1e6),
        ("m/K", 1e-6, "µm/K", 1e6),
        ("rad/m", 1e-6, "µrad/m", 1e6),
        ("1/K", 1e-6, "µm/(m K)", 1e6),
        ("m/s", 1e-6, "µm/h", 3.6e9),
        ("1/Pa", 1e-8, "µm/(m hPa)", 1e8),
        ("s", 0.1, "ms", 1e3),
        ("1", 5e-6, "µm/m", 1e6),
        ("1", 2.0, "", 1.0),
        ("K", 1.0, "K", 1.0),
        ("1/m^2", 1.0, "1/m²", 1.0),
        ("m/m^3", 1e-6, "µm/m³", 1e6),
    ],
)
def test_units_that_people_read(unit, high, shown, factor):
    assert readable(Size("size", unit, -high, high, "")) == (shown, pytest.approx(factor))


def test_small_print_of_numbers():
    assert [chance(p) for p in (0.0, 1.0, 0.5, 0.00312)] == [
        "< 0.0001",
        "> 0.9999",
        "0.5",
        "0.0031",
    ]
    assert chance(float("nan")) == "unknown"
    assert rms_and_largest(np.array([3e-6, np.nan, -4e-6])) == pytest.approx(
        (3.5355e-6, 4e-6), 1e-4
    )
    assert all(np.isnan(rms_and_largest(np.array([np.nan]))))
    unknown = replace(FOUND, band={"lost_motion": (float("nan"), float("nan"))})
    assert size_words(unknown, EFFECT.sizes[0]) == "0.8123 µm ± unknown"


@pytest.mark.parametrize(
    ("unit", "value", "half", "words"),
    [
        ("m/s2", 3.011e-12, 0.041e-12, "3.011 ± 0.041 pm/s2"),
        ("m", 3e-6, 2e-8, "3.000 ± 0.020 µm"),
        ("m", 3e-6, 2e-11, "3000.000 ± 0.020 nm"),
        ("rad/m2", 3e-19, 2e-20, "0.000300 ± 0.000020 frad/m2"),
    ],
)
def test_a_size_in_an_unusual_unit_is_not_a_row_of_zeros(unit, value, half, words):
    band = {"lost_motion": (value - half, value + half)}
    found = replace(FOUND, sizes={"lost_motion": value}, band=band)
    assert size_words(found, Size("lost_motion", unit, -1.0, 1.0, "")) == words


def test_the_bag_is_told_by_name_only_on_the_page():
    report = _report(_diagnosis(CONSISTENT), bag=Path("/somewhere/secret/run.mcap"))
    page = diagnosis_page(report, {})
    assert "run.mcap" in page and "secret" not in page


LOOK = Pattern(
    "the Y moves", ("pnp", "ppn"), "growing with time", 3e-7, 0.9, 400.0, 1e-9, ("repeat",)
)


def test_what_the_gap_looks_like_is_in_the_document():
    document = diagnosis_document(_report(_diagnosis(UNEXPLAINED, patterns=(LOOK,))))
    (look,) = document["patterns"]
    assert look["words"] == "the Y moves of pnp and ppn, growing with time"
    assert (look["lines"], look["rms_m"], look["share"]) == (["pnp", "ppn"], 3e-7, 0.9)
    unclear = replace(LOOK, share=float("nan"))
    document = diagnosis_document(_report(_diagnosis(UNEXPLAINED, patterns_after=(unclear,))))
    assert document["patterns"] == []
    assert document["patterns_after"][0]["share"] is None


@pytest.mark.parametrize("verdict", MEANING)
def test_the_head_of_the_page_tells_the_verdict_what_it_means_and_the_figures(verdict):
    found = (FOUND,) if verdict in (NAMED, AMBIGUOUS) else ()
    page = diagnosis_page(_report(_diagnosis(verdict, found), held_out=_proof()), {})
    head = page[page.index("<header>") : page.index("</header>")]
    assert f"<h1>{verdict}</h1>" in head
    assert MEANING[verdict] in head
    assert "The X moves of x." in head
    assert ("0.812 ± 0.020 µm" in head) == bool(found)
    assert "<dt>noise of a stop</dt><dd>0.1 µm</dd>" in head
    ratio = "4.95 → 1.00" if found else "4.95"
    assert f"<dt>χ² per degree of freedom</dt><dd>{ratio}</dd>" in head
    assert "<dt>the same, held out</dt><dd>10.00 → 0.90</dd>" in head


def test_the_story_of_the_page_is_in_order_and_empty_chapters_are_left_out():
    report = _report(_diagnosis(NAMED, (FOUND,)), held_out=_proof())
    page = diagnosis_page(report, _drawn(report))
    titles = re.findall(r"<h2>(\d+) ([^<]*)</h2>", page)
    assert [int(number) for number, _ in titles] == list(range(1, len(titles) + 1))
    order = ("Before", "Where it is", "Candidates", "Named", "After", "The proof", "What this run")
    places = [next(i for i, (_, t) in enumerate(titles) if t.startswith(o)) for o in order]
    assert places == sorted(places)
    bare = diagnosis_page(_report(_diagnosis(CONSISTENT, where=())), {})
    assert "The proof" not in bare and ">Named<" not in bare


def test_tables_fit_a_terminal_of_80_and_one_of_120():
    report = _report(_diagnosis(NAMED, (FOUND,)), held_out=_proof())
    for width in (80, 120):
        stream = io.StringIO()
        console = make_console(stream)
        console.text_width = width
        print_diagnosis(report, console)
        longest = max(len(line) for line in stream.getvalue().splitlines())
        assert 0.7 * width < longest <= width
        assert "…" not in stream.getvalue()


def test_settings_with_one_limit_are_one_row_and_digits_are_two():
    limits = {f"backlash of {axis}": 4.512e-8 for axis in "X"}
    text = _text(_report(_diagnosis(CONSISTENT, detection_limits=limits)))
    assert "0.045 " in text and "0.0451" not in text
    assert [two_digits(value) for value in (0.0123, 1234.0, 2.0, float("nan"))] == [
        "0.012",
        "1,200",
        "2",
        "unknown",
    ]


def test_an_unexplained_gap_is_measured_by_the_noise_and_something_is_to_be_measured_next():
    found = _report(_diagnosis(UNEXPLAINED, (), (FOUND,), patterns=(LOOK,)))
    rms, largest = rms_and_largest(found.diagnosis.residual_before)
    text = " ".join(_text(found).split())
    page = diagnosis_page(found, {})
    for said in (
        f"Known: the gap is {two_digits(rms * 1e6)} µm (rms), {two_digits(rms / 1e-7)} times",
        f"{two_digits(largest * 1e6)} µm where it is largest",
        f"leave {two_digits(rms * 1e5)} µm (rms)",
        proposed_sentences(found)[0],
    ):
        assert said in text and said in page
    assert "What to measure next:" in text
    assert not proposed_sentences(_report(_diagnosis(CONSISTENT)))
    assert "Known: the gap" not in _text(_report(_diagnosis(CONSISTENT)))


def test_what_a_run_cannot_choose_between_is_named_kind_by_kind():
    rivals = RunnerUp("backlash of Y", 300.0, 0.4, "shows the same", ambiguous=True)
    finding = replace(FOUND, runners_up=(rivals,))
    assert rivals_words(_report(_diagnosis(AMBIGUOUS, (finding,)))) == (
        "backlash of X, backlash of Y"
    )
    assert rivals_words(_report(_diagnosis(NAMED, (FOUND,)))) == ""


def test_rivals_that_are_not_ruled_out_come_first_and_then_the_likely_ones():
    rivals = [
        RunnerUp("likely", 4.0, 0.3, ""),
        RunnerUp("unlikely", 9.0, 1e-6, ""),
        RunnerUp("hopeless and small", 1.0, 0.0, ""),
        RunnerUp("hopeless", 2.0, 0.0, ""),
        RunnerUp("open", 1.0, 1e-9, "", ambiguous=True),
        RunnerUp("likelier", 2.0, 0.4, ""),
    ]
    ordered = [one.label for one in in_order(rivals)]
    assert ordered == [
        "open",
        "likelier",
        "likely",
        "unlikely",
        "hopeless",
        "hopeless and small",
    ]
