"""Whatever stands in a plan: it is one that can be executed, or a sentence says why not."""

import copy
import time

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from nodes_here import NODES, node_here
from odd_messages import MANY_TRIALS
from raw_web import resident
from small_run import small_stream

from stepdiag_ros import configuration, topics
from stepdiag_ros.cli import main
from stepdiag_ros.configuration import load_machine, machine_from_text, plan_from_text
from stepdiag_ros.messages.conversion import new_message
from stepdiag_ros.metrology.plan import MOST_STOPS
from stepdiag_ros.planning.plan_text import plan_text
from stepdiag_ros.run.feasibility import beyond_machine
from stepdiag_ros.text.intake import LONGEST_TEXT
from stepdiag_ros.text.sentence import LONGEST, PREFIX, sentence

SOURCE = "odd_plan.yaml"
SECONDS = 15.0
"""Of processor time for one text; the longest that is taken has a million characters."""
GROWTH = 200_000_000
NAMES = ("quick", "demo", "iso230_6_face", "two_axes", "move_orders")
TRACKER = """
name: tracker
origin_m: [0, 0, 0]
step_m: [0.1, 0.1, 0.1]
blocks: 1
feed_m_per_s: 0.03
tracker: {mirror_offset_m: 0.0}
lines:
  - {kind: tracker, station: a, station_m: [-0.5, 0, 0], names: [x],
     targets_m: [[0, 0, 0], [0.1, 0, 0]]}
"""


def trials(examples):
    long = settings.default.max_examples >= MANY_TRIALS
    return settings(
        max_examples=examples * (50 if long else 1),
        deadline=None,
        derandomize=True,
        database=None,
        suppress_health_check=list(HealthCheck),
    )


ODD = (
    *("", "x", "-1", "0", "1e400", "nan", "unknown", "ppp", "XYZ", "forward", "tracker", "a: b"),
    *("\u202e\u2028", "\x1b[2J", "Прямая 直線 🙂", "k" * 5000, "../../evil", "=cmd()", "1:1:1.5"),
    *(0, -1, 1, 2, 1000, 1001, 2**63, -(2**63), 10**400, True, False, None),
    *(float("nan"), float("inf"), -float("inf"), 0.0, -0.0, 1e-300, 1e308, 0.01, -0.01),
)
values = st.recursive(
    st.sampled_from(ODD)
    | st.integers()
    | st.floats()
    | st.text(max_size=20)
    | st.dates()
    | st.binary(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(st.text(max_size=8) | st.integers() | st.none(), inner, max_size=3)
    ),
    max_leaves=12,
)


def places(node, path=()):
    """Return the path of every value in a parsed text, that of the whole among them."""
    found = [path]
    if isinstance(node, dict | list):
        for key in node if isinstance(node, dict) else range(len(node)):
            found += places(node[key], (*path, key))
    return found


@st.composite
def changed(draw, parsed):
    """Return a strategy for a parsed text of which some values are odd, gone, doubled or new."""
    made = copy.deepcopy(parsed)
    for _ in range(draw(st.integers(1, 3))):
        path = draw(st.sampled_from(places(made)))
        if not path:
            if draw(st.integers(0, 20)) == 0:
                return draw(values)
            continue
        holder = made
        for key in path[:-1]:
            holder = holder[key]
        how = draw(st.sampled_from(("odd", "odd", "odd", "gone", "new", "doubled")))
        if how == "odd":
            holder[path[-1]] = draw(values)
        elif how == "gone":
            del holder[path[-1]]
        elif isinstance(holder, list):
            holder.append(copy.deepcopy(holder[path[-1]]) if how == "doubled" else draw(values))
        else:
            holder[draw(st.text(max_size=8))] = draw(values)
    return made


def dumped(made):
    return yaml.safe_dump(made, allow_unicode=True, sort_keys=False)


def judged(read, text):
    """Return what is made of a text, or None; a refusal names the source, in bounded time."""
    begin, before = time.process_time(), resident()
    try:
        made = read(text, SOURCE)
    except ValueError as error:
        said = sentence(error)
        assert SOURCE in said and len(said) <= LONGEST + 2 and said.isprintable()
        made = None
    assert time.process_time() - begin < SECONDS
    assert resident() - before < GROWTH
    return made


def executed(plan):
    """Do with a plan what is done before it moves a machine."""
    machine = load_machine("demo")[0]
    assert 0 < plan.stop_count <= MOST_STOPS
    assert isinstance(beyond_machine(plan, machine), str)
    for index, line in enumerate(plan.lines[:50]):
        plan.run_up(line)
        plan.way_back(index)
    if plan.tracker is None:
        again = plan_from_text(plan_text(plan), "written")
        assert (again.volume, again.sampling) == (plan.volume, plan.sampling)
        assert sorted(map(str, again.lines)) == sorted(map(str, plan.lines))


def parsed_plan(name):
    if name == "tracker":
        return yaml.safe_load(TRACKER)
    return yaml.safe_load(configuration.load_plan(name)[1])


@pytest.mark.parametrize("name", [*NAMES, "tracker"])
@trials(30)
@given(data=st.data())
def test_a_plan_with_odd_values_is_a_plan_or_a_sentence(name, data):
    made = judged(plan_from_text, dumped(data.draw(changed(parsed_plan(name)))))
    if made is not None:
        executed(made)


READERS = {
    "machines": machine_from_text,
    "cells": configuration.cell_from_text,
    "instruments": configuration.instrument_from_text,
    "models": configuration.model_from_text,
}


@pytest.mark.parametrize("folder", READERS)
@trials(20)
@given(data=st.data())
def test_other_files_with_odd_values_are_taken_or_refused_in_a_sentence(folder, data):
    name = data.draw(st.sampled_from(configuration.available(folder)))
    parsed = yaml.safe_load(configuration.find(name, folder).read_text())
    judged(READERS[folder], dumped(data.draw(changed(parsed))))


PIECES = (
    *("&a ", "*a", "&b ", "*b", "<<: ", "? ", ": ", "- ", "[", "]", "{", "}", ", ", "\n", "\n  "),
    *("'", '"', "|\n ", ">-\n ", "# ", "---\n", "...\n", "%TAG ! !\n", "!!int ", "!!float ''"),
    *("!!set ", "!!map ", "!!timestamp x", "!!bool x", "!!binary '%'", "!!python/name:os.system"),
    *("1:1:1", "0x" + "f" * 500, "1_0", "~", "=", "2026-13-01", "\\ud800", '"\\ud800"', "\t", "\0"),
    *("name: ", "lines: ", "blocks: 3", "step_m: [1, 1, 1]", "kind: linear", "names: [x]"),
)


@trials(200)
@given(st.lists(st.sampled_from(PIECES) | st.text(max_size=6), max_size=25).map("".join))
def test_a_text_of_yaml_s_signs_is_a_plan_or_a_sentence(text):
    judged(plan_from_text, text)


def repeated(line, count=100_000):
    return (line * count)[:LONGEST_TEXT]


def everything_measured(lines):
    """Return a plan of so many lines, each of more passes than a plan may have."""
    line = (
        "  - {kind: step_diagonal, names: [ppp, npp, pnp, ppn], orders: [XYZ, YXZ, ZXY],"
        " directions: [forward, backward]}\n"
    )
    head = "step_m: [1, 1, 1]\nblocks: 1000\nrepeats: 1000\nfeed_m_per_s: 1\nlines:\n"
    return head + lines * line


TOO_MUCH = everything_measured(lines=9)
TABLES = "".join(
    f"k{n}: &k{n} {{{', '.join(f'x{m}: *k{n - 1}' for m in range(9))}}}\n" for n in range(1, 9)
)
BOMBS = {
    "more passes than memory": everything_measured(lines=900),
    "lists of lists by references": "k0: &k0 1\n" + TABLES,
    "merged tables": "k0: &k0 {a: 1}\nk1: &k1 {<<: [*k0, *k0]}\nk2: {<<: [*k1, *k1]}\n",
    "a number of base 60": "blocks: 1" + repeated(":1", 490_000),
    "a decimal number of base 60": "blocks: 1" + repeated(":1", 490_000) + ".5",
    "a number of base 16": "blocks: 0x" + repeated("f", 900_000),
    "a number beyond all": "blocks: 1" + "0" * 399,
    "anchors": "".join(f"k{n}: &a{n} x\n" for n in range(60_000))[:LONGEST_TEXT],
    "one key": repeated("k", 900_000) + ": 1",
    "one tag": "!" + repeated("t", 900_000) + " x",
    "one comment": "#" + repeated("c", 900_000),
    "folded lines": "name: >\n" + repeated(" x\n"),
    "questions": repeated("? "),
    "documents": repeated("---\n"),
    "signs in quotes": 'name: "' + repeated("\\n", 400_000) + '"',
    "near keys": "".join(f"block{n}: 1\n" for n in range(9000)),
}


@pytest.mark.parametrize("text", BOMBS.values(), ids=BOMBS)
def test_a_bomb_is_refused_in_bounded_time_and_memory(text):
    assert judged(plan_from_text, text) is None


@pytest.mark.parametrize("text", [TOO_MUCH, "blocks: !!int ''", "blocks: 1" + "0" * 399])
@pytest.mark.parametrize(
    "command",
    [("plan", "--machine", "demo", "--check"), ("run", "--plan"), ("measure", "--plan")],
    ids=lambda command: command[0],
)
def test_a_command_refuses_a_hostile_plan_before_anything_is_done(command, text, tmp_path, capsys):
    path = tmp_path / SOURCE
    path.write_text(text)
    assert main([*command, str(path)]) == 1
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 1 and said[0].startswith(PREFIX) and SOURCE in said[0]
    assert list(tmp_path.iterdir()) == [path]


@trials(15)
@given(data=st.data())
def test_a_check_of_an_odd_plan_tells_or_refuses(data, tmp_path_factory):
    path = tmp_path_factory.mktemp("plan") / SOURCE
    path.write_text(dumped(data.draw(changed(parsed_plan("quick")))))
    program = path.with_suffix(".nc")
    code = main(["plan", "--check", str(path), "--machine", "demo", "--json", "--nc", str(program)])
    assert code == 0 or (code == 1 and not program.exists())


@pytest.mark.parametrize("name", NODES)
@trials(1)
@given(data=st.data())
def test_a_run_with_an_odd_plan_ends_no_node(name, data):
    is_refused_and_the_next_taken_up(name, data)


@pytest.fixture(autouse=True)
def nothing_left_behind(monkeypatch, tmp_path):
    """Let a recorder that takes up a run write its bag into a folder of the test."""
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("name", NODES)
@trials(4)
@given(data=st.data())
def test_more_runs_with_odd_plans_end_no_node(name, data):
    is_refused_and_the_next_taken_up(name, data)


def is_refused_and_the_next_taken_up(name, data):
    """Give a node an odd plan that somebody announces, and then a run to be taken up."""
    texts = st.sampled_from([TOO_MUCH, "!!int ''", "[" * 5000])
    texts |= changed(parsed_plan("quick")).map(dumped)
    _, topic, valid = next(one for one in small_stream() if one[1] is topics.RUN_DESCRIPTION)
    with node_here(name, *NEEDED.get(name, ())) as here:
        for _ in range(3):
            odd = new_message(topics.RUN_DESCRIPTION.type_name)
            odd.run_id, odd.plan = "20260101T000000-odd", data.draw(texts)
            for one in here.hears:
                if one.topic == topics.absolute(topics.RUN_DESCRIPTION):
                    here.give_to(one, odd)
            here.work()
        here.give(topic, valid)
        here.work()


NEEDED = {
    "monitor": ["port:=0"],
    "foxglove_server": ["port:=0"],
    "archive": ["place:=archive"],
}
