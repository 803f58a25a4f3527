"""What stands on the screen, from the sections of a real run, and how it fits."""

import math

import pytest

from stepdiag_ros.devices.interferometer import STATUS_BEAM_LOST
from stepdiag_ros.metrology.geometry import SQUARENESS, TRANSLATIONS
from stepdiag_ros.metrology.measurement import Environment, Reading
from stepdiag_ros.viewers.page.contact import Contact, SilentNode
from stepdiag_ros.viewers.page.items import MachineStatus, Said
from stepdiag_ros.viewers.page.section import micrometres
from stepdiag_ros.viewers.page.state import PageState
from stepdiag_ros.viewers.terminal.glyphs import ASCII, UNICODE
from stepdiag_ros.viewers.terminal.page import Heading, ScreenPage

HEADING = Heading("11 nodes", "17:00:00 UTC")
SIZES = [(80, 24), (120, 40), (160, 50)]


def drawn(documents, width=80, height=24, signs=UNICODE):
    shown = signs.readable(documents)
    return [line.plain for line in ScreenPage(signs).draw(shown, HEADING, width, height)]


def joined(rows):
    return " ".join(" ".join(rows).split())


def known(*items):
    """Return the documents of a view that has heard of these items alone."""
    state = PageState()
    for item in items:
        state.take(item)
    return state.news()[1]


@pytest.fixture(scope="module")
def faulty(ended):
    """Return the documents of the same run where all kinds of things are wrong."""
    state = PageState()
    state.take(Said("recorder: disk", 1, "1.5 GB are free"))
    state.take(Said("cnc_bridge: heartbeat", 2, "the controller is silent " * 8))
    for number in range(5):
        state.take(Said(f"node{number}: task", 1, "a warning"))
    state.take(MachineStatus(1, True, "the door is open"))
    silent = (SilentNode("/solver", "solver"),)
    state.take(Contact(True, frozenset({"recorder"}), silent, True, frozenset()))
    nothing = Environment(math.nan, math.nan, math.nan, math.nan)
    state.take(Reading(0, 1, math.nan, math.nan, math.nan, STATUS_BEAM_LOST, nothing))
    return ended | {name: state.document(name) for name in ("faults", "beam", "weather")}


@pytest.fixture(params=["nothing", "ended", "faulty"])
def documents(request, ended, faulty):
    return {"nothing": known(), "ended": ended, "faulty": faulty}[request.param]


@pytest.mark.parametrize("signs", [UNICODE, ASCII], ids=["unicode", "ascii"])
@pytest.mark.parametrize(("width", "height"), [*SIZES, (60, 20), (10, 3), (1, 1)])
def test_no_row_is_wider_and_no_view_higher_than_the_terminal(documents, width, height, signs):
    rows = drawn(documents, width, height, signs)
    assert 0 < len(rows) <= height and max(map(len, rows)) <= width
    assert signs is UNICODE or all(row.isascii() for row in rows)


@pytest.mark.parametrize(("width", "height"), SIZES)
def test_an_ended_run_has_all_essentials(ended, run, width, height):
    rows = drawn(ended, width, height)
    text = joined(rows)
    stop, block, result = run.stops[-1], run.blocks[-1], run.results[-1]
    assert run.run_id in rows[0] and rows[0].endswith("11 nodes  17:00:00 UTC")
    assert ended["run"]["words"] in rows[1]
    assert f"Last stop: {stop.command.stop}, {stop.readings} readings" in text
    last = ended["stop"]["last"]
    assert f"from perfect {last['from_nominal']}" in text
    assert f"from model {last['from_expected']}" in text
    # Counted forward along the line; this was a pass backward.
    assert block.line.direction == "backward"
    deviation = micrometres(
        block.nominal_displacement - block.displacement, 1.96 * block.standard_uncertainty
    )
    assert f"last: {block.axis} {block.block}, {deviation}" in text
    assert f"Least squares, {result.lines} passes" in text
    for one in ended["curves"]["curves"]:
        shown = one["worst"]["text"] if one["worst"] else "unknown"
        assert f"{one['name']} {shown}" in text
    for one in ended["squareness"]["figures"]:
        assert f"{one['name']} {one['words']} {one['text']}" in text
    for one in ended["weather"]["values"]:
        assert f"{one['name']} {one['text']}" in text
    assert f"Verdict: {run.diagnoses[-1].verdict}; {run.diagnoses[-1].lines} of" in text
    assert f"signal {'[' + '█' * 18 + ']'} 100 %" in text
    assert "too small" not in text


def test_before_anything_is_known_all_is_said_to_be_unknown():
    text = joined(drawn(known()))
    for said in (
        "no run is known yet",
        "Faults: no message yet",
        "Beam: no reading has come yet",
        "signal unknown",
        "reading unknown",
        "Last stop: none yet",
        "Blocks: none yet",
        "air unknown, pressure unknown",
        "humidity unknown, machine unknown",
        "Largest errors: no result yet",
        *(f"{name} {words} unknown" for name, words in zip(SQUARENESS, PAIRS, strict=True)),
        "Verdict: no pass has been compared with the model yet",
    ):
        assert said in text, said
    assert " 0" not in text.replace(HEADING.time, "")


PAIRS = ("Y to X", "Z to X", "Z to Y")


@pytest.mark.parametrize(("width", "height"), SIZES)
def test_faults_come_first_and_what_has_no_room_is_counted(faulty, width, height):
    rows = drawn(faulty, width, height)
    (first,) = (number for number, row in enumerate(rows) if row.startswith("Faults (9): "))
    assert rows[first] == "Faults (9): fault: machine: the door is open"
    assert rows[first + 1].startswith("  fault: nodes: solver node /solver is silent")
    text = joined(rows)
    assert "Beam: lost, the beam is lost" in text and "signal unknown" in text
    # What stands below keeps its place.
    assert all(name in text for name in TRANSLATIONS) and "Verdict: " in text
    hidden = [one for one in range(5) if f"node{one}: task" not in text]
    assert bool(hidden) == ("more" in text)
    assert height > 24 or hidden


def test_the_whole_view_leaves_nothing_out(ended, faulty):
    text = joined(drawn(faulty, 80, None)[1:])
    assert f"Plan: {ended['run']['plan']}" in text
    assert all(one["text"].strip() in text for one in faulty["faults"]["faults"])
    assert ended["verdict"]["sentence"] in text
    for remark in ended["curves"]["remarks"]:
        assert " ".join(remark.split()) in text
    for course in ended["volume"]["courses"]:
        assert f"{course['name']} " in text
    assert "…" not in text


def test_a_narrow_terminal_says_which_run_of_which_plan_it_shows(ended):
    text = joined(drawn(ended, 60, 20)[:4])
    assert ended["run"]["run_id"] in text and " ".join(ended["run"]["plan"].split()) in text


def test_a_terminal_that_is_too_small_is_told_so(ended):
    assert drawn(ended, 60, 20)[-1] == "too small: all is shown in 80 x 24"


def test_nobody_in_the_graph_steers_the_terminal():
    heard = known(Said("evil: task", 2, "\x1b]0;title\x07\x1b[2J\u202edoor\nopen\x9b1m"))
    rows = drawn(heard)
    assert all(row.isprintable() for row in rows)
    assert "door open" in joined(rows)


def test_no_information_is_in_a_colour_alone(faulty):
    """Every coloured piece is a word that says the same."""
    for line in ScreenPage(UNICODE).draw(faulty, HEADING, 160, 50):
        for span in line.spans:
            if span.style not in ("", "bold"):
                assert any(sign.isalpha() for sign in line.plain[span.start : span.end])


@pytest.mark.parametrize(
    ("values", "shown", "in_ascii"),
    [
        ([0.0, 7.0], "▁█", "18"),
        ([1.0, None, 1.0], "▁?▁", "1?1"),
        ([None], "?", "?"),
        ([-3.5, 0.0, 3.5], "▁▅█", "158"),
        ([], "", ""),
    ],
)
def test_a_row_of_values(values, shown, in_ascii):
    assert UNICODE.row(values) == shown and ASCII.row(values) == in_ascii


def test_a_bar_is_full_only_up_to_its_ends():
    assert UNICODE.bar(0.5, 12) == "[█████░░░░░]"
    assert ASCII.bar(2.0, 6) == "[####]" and ASCII.bar(-1.0, 6) == "[....]"


def test_ascii_is_read_as_what_it_stands_for():
    assert ASCII.text("-1.20 ± 0.13 µm at 20.5 °C, χ² …") == "-1.20 +- 0.13 um at 20.5 C, chi2 ..."
    assert ASCII.text("Fräse 机") == "Frase ?"


def test_a_row_of_blocks_that_is_not_the_whole_pass_says_so():
    from stepdiag_ros.viewers.terminal.sections import before_lines, block_lines

    blocks = {
        "blocks": [[float(k), "X", float(k), 0.1] for k in range(50)][::-1],
        "before": [[0.5, "X", None, None]],
        "last": {"axis": "X", "block": 3, "deviation": "1.0 ± 0.1 µm"},
    }
    title, row, last = (line.plain for line in block_lines(blocks, 30, UNICODE))
    assert title == "Blocks, last 30: 20.0 to 49.0 µm"
    assert len(row) == 30 and row[0] == "▁" and row[-1] == "█"
    assert last == "last: X 3, 1.0 ± 0.1 µm"
    assert [line.plain for line in before_lines(blocks, 30, UNICODE)] == [
        "Blocks of the pass before off nominal: unknown",
        "?",
    ]
