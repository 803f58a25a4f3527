"""Whatever an origin says, a control executes the same: text from a bag is never more than text.

The oracle knows nothing of how comments are written: it takes comments out of the files as a
control does, breaks lines wherever anybody might, and compares what is left with what a harmless
origin leaves.
"""

import re
from dataclasses import asdict, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from machines_for_tables import measured
from nc_examples import MILLING, machine
from nc_examples import PROGRAM as SETUP
from refused import refused

from stepdiag_ros.commands import compensate, compensate_nc
from stepdiag_ros.compensation import control, controls
from stepdiag_ros.compensation.control import Layout, checked_files, checked_settings
from stepdiag_ros.compensation.identified import Identified, Origin
from stepdiag_ros.compensation.nc_readback import refuse_foreign_words
from stepdiag_ros.compensation.nc_rewrite import RewriteSettings, rewrite
from stepdiag_ros.compensation.nc_words import NcError
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.planning.nc_writing import Move, nc_program
from stepdiag_ros.text.controls import Comment, one_line, refuse_foreign

BREAKS = "\n\r\v\f\x1c\x1d\x1e\x85\u2028\u2029"
"""Whatever one program or another takes for the end of a line."""
SIGNS = BREAKS + "();%$#@'\"[]{}=:,!&|<>/\\\0\t\x1b\x7f\u202e\u2066\ufeff（）；％"
PIECES = (
    "$MA_MAX_AX_VELO[AX1]=99999",
    "N5 $MA_MAX_AX_VELO[AX1]=1",
    "M30",
    "G0 Z-500",
    "%_N_X_MPF",
    "COMP_FILE = evil.comp",
    "3620 X = 9",
    "MSG,",
    "py,import os",
    "LOGOPEN,/etc/passwd",
    "#INCLUDE /etc/passwd",
    "E_XX,0.0,0,1.0,,",
    "[END]",
)
NAUGHTY = st.lists(
    st.one_of(
        st.sampled_from(PIECES),
        st.sampled_from(SIGNS),
        st.text(st.characters(exclude_categories=("Cs",)), max_size=8),
    ),
    max_size=12,
).map("".join)
DIGEST = "0123456789abcdef" * 4
TEXTS = tuple(key for key in asdict(Origin()) if key != "sha256")
ORIGINS = st.builds(Origin, sha256=st.sampled_from(["", DIGEST]), **dict.fromkeys(TEXTS, NAUGHTY))
ATTACK = "1.0" + "".join(f"{end}$MA_MAX_AX_VELO[AX1]=9{end}N5 G0 Z-9 ) M30 ; % " for end in BREAKS)


def lines_of(text):
    return re.split(f"[{BREAKS}]", text)


def executed(name, text):
    """Return what a control executes of a file: each line without its comment."""
    if name.endswith(".json"):
        return []
    marks = {".INI": ";", ".ini": "[#;]", ".txt": "#", ".csv": "#", ".nc": r"\([^()]*\)"}
    mark = next((found for end, found in marks.items() if name.endswith(end)), None)
    if mark is None:
        return lines_of(text)
    rest = mark if mark.startswith("\\") else f"{mark}.*"
    done = [re.sub(rest, "", line).strip() for line in lines_of(text)]
    return [line for line in done if line]


def files_of(name, origin):
    _, identified = measured()
    identified = replace(identified, origin=origin)
    found = control(name)
    layout = Layout(settings=checked_settings(found, {}), header=compensate._header(identified))
    return checked_files(found, identified, layout)


def did(files):
    return {name: executed(name, text) for name, text in files.items()}


harmless = cache(lambda name: did(files_of(name, Origin(file="run.mcap"))))


@pytest.mark.parametrize("name", controls())
@settings(max_examples=60)
@given(origin=ORIGINS)
def test_tables_do_the_same_whatever_their_origin_says(name, origin):
    files = files_of(name, origin)
    assert did(files) == harmless(name)
    for file, text in files.items():
        if not file.endswith(".json"):
            # "µm" is the one sign of ours beyond ASCII.
            assert text.replace("µ", "u").isascii(), file
            assert not re.search(r"[\0-\x09\x0b-\x1f\x7f]", text), file


@pytest.mark.parametrize("field", TEXTS)
@pytest.mark.parametrize("name", controls())
def test_no_field_of_the_origin_gets_a_line_of_its_own(name, field):
    files = files_of(name, replace(Origin(), **{field: ATTACK}))
    assert did(files) == harmless(name)
    if name == "siemens":
        assert "MA-MAX" in files["AX_EEC.INI"] or "MA_MAX" in files["AX_EEC.INI"], "still told"


def rewritten(origin, name):
    identified = Identified(machine(), {}, origin)
    path = type("Path", (), {"name": name})
    header = compensate_nc._header(identified, path, "0" * 64)
    written = rewrite(MILLING, "m.nc", machine(), RewriteSettings(program=SETUP), header)
    refuse_foreign_words(MILLING, written)
    return written.text


harmless_program = cache(lambda: executed("x.nc", rewritten(Origin(), "m.nc")))


@settings(max_examples=30)
@given(origin=ORIGINS, program=NAUGHTY)
def test_a_rewritten_program_does_the_same_whatever_its_origin_says(origin, program):
    text = rewritten(origin, program)
    assert executed("x.nc", text) == harmless_program()
    assert max(map(len, text.split("\n"))) < 255, "the longest line that LinuxCNC reads"
    assert not re.search(r"\(\s*(msg|py|log|probe|debug|abort)", text, re.IGNORECASE)


MOVES = [Move((0.0, 0.0, 0.0), 0.5), Move((0.01, 0.0, 0.0), 0.5, program_stop="align")]


@settings(max_examples=200)
@given(name=NAUGHTY, remark=NAUGHTY, comment=NAUGHTY)
def test_a_planned_program_does_the_same_whatever_its_names_say(name, remark, comment):
    first, second = MOVES
    moves = [replace(first, comment=comment), replace(second, program_stop=f"align {comment}")]
    text = nc_program(moves, feed_m_per_s=0.01, name=name, remarks=(remark,))
    plain = nc_program(MOVES, feed_m_per_s=0.01, name="x")
    assert executed("x.nc", text) == executed("x.nc", plain)
    assert text.isascii() and not re.search(r"\((MSG|PY|LOG|PROBE|DEBUG|ABORT)", text)


@given(NAUGHTY)
def test_a_line_that_is_shown_is_one_line(text):
    shown = one_line(text)
    assert shown.isprintable() and lines_of(shown) == [shown]


def test_a_comment_keeps_what_can_be_read():
    capitals = Comment("(", ")", signs=".,+-/=[]", capitals=True)
    assert capitals.text("a (b) % ü; µm: #1 @x_y ×²\n") == "A [B] PERCENT U, UM - 1 X-Y X2"
    assert Comment("; ").lines("run: 2026-01-02 Fräse_3, 5 µm") == [
        "; run: 2026-01-02 Frase_3, 5 um"
    ]
    assert Comment("(", ")").lines("MSG, hello") == ["(- MSG, hello)"]
    assert Comment("; ").lines(" \u2028 ") == []
    long = Comment("; ").lines("y" * 10_000_000)
    assert sum(map(len, long)) < 1000 and max(map(len, long)) <= 102


@pytest.mark.parametrize("digest", [ATTACK, DIGEST.upper(), DIGEST[1:], DIGEST + "\n"])
def test_a_digest_is_a_digest(digest):
    with refused(Refusal, "malformed", "64", aspect="digest"):
        Origin(sha256=digest)


def foreign(text, line):
    lines = text.splitlines(keepends=True)
    return "".join([*lines[:2], f"{line}\n", *lines[2:]])


@pytest.mark.parametrize("line", [*PIECES[:4], "$AN_CEC[0,1]=1e9", "; tab\t", "X\rY", "nan"])
@pytest.mark.parametrize("name", [name for name in controls() if name != "generic"])
def test_a_line_that_is_not_ours_is_found_when_a_file_is_read_once_more(name, line):
    found = control(name)
    for file, text in files_of(name, Origin()).items():
        known = next(k for pattern, k in found.grammar.items() if re.fullmatch(pattern, file))
        refuse_foreign(file, text, *known)
        with refused(Refusal, "rejected", file, "3"):
            refuse_foreign(file, foreign(text, line), *known)


@pytest.mark.parametrize("value", [np.nan, np.inf, 100.1, -1e9])
@pytest.mark.parametrize("name", [name for name in controls() if name != "generic"])
def test_positions_that_no_control_can_take_are_refused(name, value):
    _, identified = measured()
    error_map = identified.error_map
    nodes = np.array(error_map.nodes[0])
    nodes[0 if not value > 0 else -1] = value
    # As a document that was forged may have them: no check of the map stands between.
    forged = object.__new__(type(error_map))
    forged.__dict__.update(vars(error_map), nodes=(nodes, *error_map.nodes[1:]))
    layout = Layout(settings=checked_settings(control(name), {}))
    with refused(Refusal, "out_of_range", aspect="position"):
        checked_files(control(name), replace(identified, error_map=forged), layout)


@pytest.mark.parametrize("axes", ["X1\n$MA,Y1,Z1", "../X,Y,Z", "X]=1,Y,Z", "X,Y,é"])
@pytest.mark.parametrize("name", ["siemens", "heidenhain", "fanuc"])
def test_names_of_axes_are_names(name, axes):
    _, identified = measured()
    layout = Layout(settings=checked_settings(control(name), {"axes": axes}))
    with refused(Refusal, "malformed", aspect="axes"):
        checked_files(control(name), identified, layout)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("M30", "M30 M8"),
        ("S3000", "S30000"),
        ("(POCKET)", "(POCKET) (MSG,x)"),
        ("G4 P1.5", "G4 P1.5 M5"),
        ("(from", "M3\n(from"),
        ("(from a test)", "(py,from a test)"),
    ],
)
def test_a_word_that_the_original_lacks_is_found(old, new):
    made = rewrite(MILLING, "m.nc", machine(), RewriteSettings(program=SETUP), ["from a test"])
    refuse_foreign_words(MILLING, made)
    assert old in made.text
    with refused(NcError, where="the rewritten program"):
        refuse_foreign_words(MILLING, replace(made, text=made.text.replace(old, new, 1)))


def test_the_screen_names_the_steps_of_the_page_for_siemens():
    said = " ".join(control("siemens").says)
    page = Path(__file__).parents[2] / "docs" / "compensation.md"
    steps = page.read_text(encoding="utf-8").partition("### Siemens")[2].partition("###")[0]
    for named in (
        "MD38000",
        "MD18342",
        "MD32700",
        "MD32710",
        "start-up file",
        "reset",
        "reference",
    ):
        assert named in said and named in steps
