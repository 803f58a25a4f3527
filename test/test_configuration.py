"""Plan, machine and cell files: those of the package, and every way in which one can be wrong."""

from hashlib import sha256
from pathlib import Path

import pytest
import yaml
from refused import a_fault, refused

from stepdiag_ros.configuration import (
    available,
    cell_from_text,
    find,
    load_cell,
    load_machine,
    load_model,
    load_plan,
    machine_from_text,
    parse_yaml,
    plan_from_text,
    plan_given,
    without_effects,
)
from stepdiag_ros.metrology.refusal import Refusal

GOOD = """\
name: small
step_m: [0.01, 0.01, 0.01]
blocks: 2
feed_m_per_s: 1e-2
lines:
  - kind: linear
    names: [x]
"""


@pytest.mark.parametrize(
    ("name", "lines", "stops"),
    [
        ("check", 24, 12 * 5 + 12 * 13),
        ("demo", 28, 12 * 13 + 16 * 37),
        ("ibaraki_hata_2010", 60, 15 * 13 + 45 * 37),
        ("iso230_2", 30, 30 * 9),
        ("iso230_6_body", 40, 40 * 9),
        ("iso230_6_face", 60, 60 * 9),
        ("kimm", 21, 9 * 13 + 12 * 37),
        ("move_orders", 60, 12 * 13 + 48 * 37),
        ("quick", 6, 3 * 4 + 3 * 10),
    ],
)
def test_plans_of_the_package(name, lines, stops):
    plan, text = load_plan(name)
    assert len(plan.lines) == lines
    assert plan.stop_count == stops
    assert plan == plan_from_text(text, "again")


def test_every_file_of_the_package_can_be_read():
    assert {"demo", "ibaraki_hata_2010", "kimm", "move_orders", "quick"} <= set(available("plans"))
    for folder, load in (("plans", load_plan), ("machines", load_machine), ("cells", load_cell)):
        for name in available(folder):
            assert load(name)[1]


def test_every_key_of_a_plan_is_explained_in_the_demo():
    text = find("demo", "plans").read_text()
    for key in (
        "origin_m",
        "directions",
        "repeats",
        "offset_m",
        "mirror_offset_m",
        "orders",
        "pause_for_setup",
        "one_alignment_per_diagonal",
    ):
        assert key in text
    assert "\noverrun_m: 0.0\n" in text
    for key in ("dwell_s", "settle_s", "window_s", "longest_wait_s", "stop_attempts"):
        line = next(line for line in text.splitlines() if line.strip().startswith(key))
        assert "#" in line


def test_a_path_goes_before_a_name_of_the_package(tmp_path, monkeypatch):
    path = tmp_path / "plan.yaml"
    path.write_bytes(b"\xef\xbb\xbf" + GOOD.replace("\n", "\r\n").encode())
    assert load_plan(path)[0].name == "small"
    monkeypatch.chdir(tmp_path)
    assert load_plan("plan.yaml")[0].feed == 0.01
    (tmp_path / "demo").mkdir()
    assert load_plan("demo")[0].volume.blocks == 12


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            GOOD.replace("blocks: 2", "blocks: [2"),
            a_fault("malformed", "wrong.yaml", aspect="YAML"),
        ),
        (GOOD.replace("blocks: 2", "bloks: 2"), a_fault("missing", "wrong.yaml", about="blocks")),
        (GOOD + "repeat: 2\n", a_fault("unknown", "repeats", about="repeat")),
        (GOOD + "blocks: 3\n", a_fault("malformed", "blocks", "wrong.yaml", "8", aspect="YAML")),
        (
            GOOD.replace("[x]", "[w]"),
            a_fault("unknown", "w", "wrong.yaml", "lines[0]", about="names"),
        ),
        (GOOD.replace("1e-2", "fast"), a_fault("malformed", "fast", about="feed_m_per_s")),
        (
            GOOD.replace("blocks: 2", "blocks:\n\t- 1"),
            a_fault("malformed", "wrong.yaml", "4", aspect="YAML"),
        ),
        ("just words", a_fault("malformed", "wrong.yaml", aspect="section")),
        ("", a_fault("too_few", "wrong.yaml")),
        ("a: !!python/object:os.system ls", a_fault("malformed", "wrong.yaml", "1", aspect="YAML")),
        ("a: \x07", a_fault("malformed", "wrong.yaml")),
    ],
)
def test_a_wrong_plan_is_refused_in_one_sentence(text, message, tmp_path):
    path = tmp_path / "wrong.yaml"
    path.write_text(text)
    with refused(Refusal, message) as refusal:
        load_plan(path)
    assert str(path) in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_a_plan_is_given_by_file_by_name_or_by_its_text(tmp_path):
    path = tmp_path / "good.yaml"
    path.write_text(GOOD)
    by_file, text = plan_given(f" {path}\n")
    assert text == GOOD and plan_given(GOOD) == (by_file, GOOD)
    assert plan_given("quick")[0] == load_plan("quick")[0]
    in_one_line = str(yaml.safe_load(GOOD))
    assert plan_given(in_one_line) == (by_file, in_one_line)
    with refused(Refusal, "missing", about="blocks"):
        plan_given(GOOD.replace("blocks: 2", "bloks: 2"))
    with refused(Refusal, "not_found", "quik"):
        plan_given("quik")


@pytest.mark.parametrize(
    ("written", "hint"),
    [("[0,8, 0,5, 0,4]", True), ("[1, 0,5, 0,4]", True), ("[1, 2]", False), ("[1.0, 2]", False)],
)
def test_decimal_commas_are_told_as_such(tmp_path, written, hint):
    path = tmp_path / "mine.yaml"
    path.write_text(
        f"name: mine\nchain: XYZ\ntravel_low_m: [0, 0, 0]\ntravel_high_m: {written}\n"
        "feed_limit_m_per_s: 0.5\nacceleration_m_per_s2: 1.0\n"
    )
    with refused(Refusal, "malformed", "travel_high_m", "mine.yaml") as info:
        load_machine(path)
    assert ("0.8, not 0,8" in str(info.value)) == hint


def test_a_file_that_is_not_there(tmp_path):
    with refused(Refusal, "not_found", "demoo", "ibaraki_hata_2010"):
        load_plan("demoo")
    with refused(Refusal, "not_found", "nothing.yaml"):
        load_machine(tmp_path / "nothing.yaml")
    (tmp_path / "mine.yaml").write_text("")
    with refused(Refusal, "not_found", f"'{tmp_path / 'mine.yaml'}'?"):
        load_machine(tmp_path / "mine.yml")
    with refused(Refusal, "wrong_kind", aspect="folder"):
        load_cell(tmp_path)
    binary = tmp_path / "binary.yaml"
    binary.write_bytes(b"\xff\xfe\x00\x81")
    with refused(Refusal, "wrong_kind", "binary.yaml", aspect="text"):
        load_plan(binary)


def test_a_number_without_a_point_is_a_number():
    assert plan_from_text(GOOD, "plan").feed == 0.01
    assert parse_yaml("a: 1e-7", "x") == {"a": "1e-7"}


def test_what_a_bag_tells_of_a_cell_holds_no_effect_and_no_comment():
    open_cell, hidden = (find(name, "cells").read_text() for name in ("demo", "hidden_several"))
    assert without_effects(open_cell, "cell") == open_cell
    assert without_effects("", "cell") == ""
    told = without_effects(hidden, "cell")
    head, rest = told.split("\n", 1)
    assert head.endswith(sha256(hidden.encode()).hexdigest()) and "#" not in rest
    for word in ("effect: backlash", "lost_motion", "effect: settling", "thermal growth"):
        assert word in hidden and word not in told
    before, after = parse_yaml(hidden, "hidden"), parse_yaml(told, "told")
    assert before.pop("effects") and after == before
    assert cell_from_text(told, "told").effects == ()
    with refused(Refusal, "malformed", "1", aspect="YAML"):
        without_effects("effects: [", "told")


MACHINE = """\
chain: YXZ
travel_low_m: [0, 0, 0]
travel_high_m: [0.6, 0.4, 0.3]
feed_limit_m_per_s: 0.5
acceleration_m_per_s2: 2
"""


def test_a_travel_in_millimetres_is_asked_back():
    assert machine_from_text(MACHINE, "mine").travel_high_m == (0.6, 0.4, 0.3)
    told = MACHINE.replace("[0.6, 0.4, 0.3]", "[600, 400, 300]")
    with refused(Refusal, "out_of_range", "600 m", "[0.6, 0.4, 0.3]", about="travel_high_m",
                 where="mine"):  # fmt: skip
        machine_from_text(told, "mine")


def test_all_keys_that_a_machine_lacks_are_named_at_once():
    with refused(Refusal, "missing", about="chain, feed_limit_m_per_s"):
        machine_from_text(
            MACHINE.replace("chain: YXZ", "name: mine").replace("feed_limit_m_per_s: 0.5\n", ""),
            "mine",
        )


def test_the_machine_file_of_the_page_is_complete():
    page = (Path(__file__).parents[1] / "docs" / "by_hand.md").read_text(encoding="utf-8")
    text = page.partition("```yaml\nname: my machine")[2].partition("```")[0]
    assert machine_from_text("name: my machine" + text, "page").chain == "YXZ"


@pytest.mark.parametrize(
    ("load", "given", "needed"),
    [
        (load_plan, "cells", "plan"),
        (load_cell, "plans", "cell"),
        (load_cell, "machines", "cell"),
        (load_machine, "cells", "machine"),
        (load_model, "cells", "model"),
        (load_model, "plans", "model"),
    ],
)
def test_a_file_of_another_kind_is_refused_by_its_kind(load, given, needed):
    path = find("demo", given)
    with refused(Refusal, "wrong_kind", str(path), f"'{needed}'", about=given.removesuffix("s")):
        load(path)


def test_the_kind_of_every_file_of_the_package_is_seen_by_its_keys():
    for kind, load in (("plans", load_cell), ("cells", load_plan), ("models", load_plan)):
        for name in available(kind):
            with refused(Refusal, "wrong_kind", about=kind.removesuffix("s")):
                load(find(name, kind))
