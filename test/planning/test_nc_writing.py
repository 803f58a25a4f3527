"""NC programs read back by an interpreter of their own: positions, dwells, feeds, stops, limits."""

from dataclasses import replace

import numpy as np
import pytest
from gcode_reader import Machine as Controller
from refused import a_fault, refused

from stepdiag_ros.configuration import available, load_machine, load_plan
from stepdiag_ros.metrology.plan import DIAGONAL, Line, Plan, Volume
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.planning.moves import moves_of, passes_of, program_of
from stepdiag_ros.planning.nc_writing import DWELL_FORMS, Dialect, Move, nc_program
from stepdiag_ros.run.sequence import Answer, Sequence, State

MOVES = [
    Move((0.0, 0.0, 0.0), 0.5, "first, at 20 °C; über (all)"),
    Move((0.01, 0.0, 0.0), 1.0),
    Move((0.01, 0.0, 0.0), 0.4, program_stop="align"),
    Move((0.02, 0.03, -0.04), 0.4),
    Move((0.03, 0.04, -0.05), 0.4, at_once=True),
]


def program(moves=MOVES, **options):
    dialect = Dialect(**options)
    return nc_program(moves, feed_m_per_s=0.033, name="a program", dialect=dialect)


@pytest.mark.parametrize("form", DWELL_FORMS)
def test_every_dwell_form_says_the_same_times(form):
    read = Controller(form).run(program(dwell=form))
    assert [seconds for _, seconds, _ in read.stays] == [0.5, 1.0, 0.4, 0.4, 0.4]
    assert [place for place, _, _ in read.stays] == [
        (0.0, 0.0, 0.0),
        (10.0, 0.0, 0.0),
        (10.0, 0.0, 0.0),
        (20.0, 30.0, -40.0),
        (30.0, 40.0, -50.0),
    ]
    assert {feed for _, _, feed in read.stays} == {1980.0}
    assert read.stops == [2]


def test_axes_move_one_at_a_time_unless_told_otherwise():
    moved = [axes for _, axes in Controller().run(program()).path]
    assert moved == ["X", "Y", "Z", "X", "X", "Y", "Z", "XYZ"]


def test_the_first_approach_is_one_axis_at_a_time_even_of_a_move_at_once():
    text = program([Move((0.1, 0.1, 0.1), 0.5, at_once=True)])
    assert [axes for _, axes in Controller().run(text).path] == ["X", "Y", "Z"]


def test_the_frame_of_the_program_is_as_asked():
    text = program(program_number=42, line_numbers=True)
    lines = text.splitlines()
    assert lines[0] == lines[-1] == "%"
    assert lines[1] == "O0042 (A PROGRAM)"
    assert lines[2].startswith("N10 (")
    assert Controller().run(text).path == Controller().run(program()).path
    assert "%" not in program(percent=False)


def test_line_numbers_begin_again_and_stay_within_four_digits():
    many = [Move((0.001 * (index % 2), 0.0, 0.0), 0.1) for index in range(1200)]
    numbers = [int(line[1:].split()[0]) for line in program(many, line_numbers=True).split("\n")
               if line.startswith("N")]  # fmt: skip
    assert len(numbers) > 2000 and min(numbers) >= 1 and max(numbers) <= 9999
    assert all(numbers[i + 1] == numbers[i] + 10 or numbers[i + 1] == 10
               for i in range(len(numbers) - 1))  # fmt: skip


def test_the_head_warns_and_names_the_box_and_the_rounding():
    moves = [Move((i / 3000.0, -0.1, 0.0), 1.0) for i in range(3)]
    head = " ".join(Controller().run(program(moves)).comments)
    assert "CHECK TRAVEL, TOOL, MIRROR AND CABLE BEFORE RUNNING" in head
    assert "X 0.0000 TO 0.6667, Y -100.0000 TO -100.0000" in head
    assert "ROUNDED BY UP TO 0.033 UM" in head
    assert "ROUNDED" not in " ".join(Controller().run(program()).comments)


@pytest.mark.parametrize("decimals", [3, 4, 5, 6])
def test_positions_are_within_half_the_last_decimal(decimals):
    rng = np.random.default_rng(1)
    wanted = rng.uniform(-1.0, 1.0, (30, 3))
    text = program([Move(tuple(row), 0.1) for row in wanted.tolist()], decimals=decimals)
    places = np.array([place for place, _, _ in Controller().run(text).stays]) * 1e-3
    assert np.max(np.abs(places - wanted)) <= 0.5000001e-3 * 10.0**-decimals


@pytest.mark.parametrize(
    ("moves", "said"),
    [
        ([], a_fault("too_few")),
        ([Move((0.0, float("nan"), 0.0), 1.0)], a_fault("out_of_range", "1", aspect="target")),
        ([Move((0.0, -100.1, 0.0), 1.0)], a_fault("out_of_range", "1", aspect="target")),
        ([Move((0.0, 0.0, 0.0), -1.0)], a_fault("out_of_range", "1", "-1", aspect="dwell")),
        (
            [Move((0.0, 0.0, 0.0), 1.0), Move((2e-8, 0.0, 0.0), 1.0)],
            a_fault("mismatch", "2", "X", "0"),
        ),
    ],
)
def test_what_no_program_can_say_is_refused(moves, said):
    with refused(Refusal, said):
        program(moves)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"dwell": "U_s"}, a_fault("unknown", "U_s")),
        ({"decimals": 2}, a_fault("out_of_range", "2")),
        ({"program_number": 10000}, a_fault("out_of_range", "10000", "1", "9999")),
    ],
)
def test_what_no_controller_reads_is_refused(options, said):
    with refused(Refusal, said):
        Dialect(**options)


@pytest.mark.parametrize("feed", [float("nan"), float("inf"), 0.0, -0.01, 1e-9, 1e6])
def test_a_feed_that_is_none_is_refused(feed):
    with refused(Refusal, "out_of_range", aspect="feed"):
        nc_program(MOVES, feed_m_per_s=feed, name="x")


def stops_of(plan):
    return np.concatenate([line.stops(plan.volume) for line in plan.lines])


@pytest.mark.parametrize("name", available("plans"))
def test_the_program_of_a_plan_stays_at_its_stops(name):
    plan, machine = load_plan(name)[0], load_machine("demo")[0]
    read = Controller().run(program_of(plan, machine))
    places = np.array([place for place, _, _ in read.stays]) * 1e-3
    assert places.shape == (plan.stop_count, 3)
    assert np.max(np.abs(places - stops_of(plan))) <= 0.05e-6
    sampling = plan.sampling
    dwell = max(sampling.dwell, sampling.settle + sampling.window)
    for _, seconds, feed in read.stays:
        assert seconds == pytest.approx(dwell, abs=1e-3)
        assert feed == pytest.approx(plan.feed * 6e4)
    if not any(line.kind == DIAGONAL for line in plan.lines):
        assert {len(axes) for _, axes in read.path} == {1}


def test_the_program_stops_for_every_new_setup_and_only_there():
    plan, machine = load_plan("demo")[0], load_machine("demo")[0]
    read = Controller().run(program_of(plan, machine))
    wanted, done = [], 0
    for one in passes_of(plan):
        if one.new_setup:
            wanted += [done, done]
        done += one.stops
    assert read.stops == wanted
    assert len(read.stops) == 2 * 7


def commanded_by_the_sequencer(plan, start):
    """Return the targets of a run in which every command is obeyed and every stop settles."""
    sent = []
    sequence = Sequence(plan, start, sent.append, lambda: None)
    sequence.start(0, 0.0)
    now = 0
    while sequence.state is State.RUNNING:
        now += 10**10
        sequence.beam_ready(sequence.progress(now).setup)
        sequence.update(now, 0.0)
        command = sent[-1]
        sequence.answered(command.command_id, Answer.IN_POSITION, "", now, 0.0)
        sequence.settled(command.line_index, command.attempt, command.stop, "")
        sequence.stored(command.command_id)
        now += 10**10
        sequence.update(now, 0.0)
    assert sequence.state is State.FINISHED
    targets = [start]
    for command in sent:
        if command.target != targets[-1]:
            targets.append(command.target)
    return targets[1:]


def small_plan(overrun):
    lines = (
        Line("linear", "x", "", 0, "forward"),
        Line("linear", "x", "", 0, "backward"),
        Line("step_diagonal", "npp", "YZX", 0, "forward"),
        Line("diagonal", "pnp", "", 0, "forward"),
        Line("diagonal", "pnp", "", 0, "backward"),
        Line("diagonal", "n0p", "", 0, "forward", (0.0, 0.02, 0.0)),
    )
    volume = Volume((0.01, 0.02, 0.03), (0.02, 0.03, 0.01), 3)
    return Plan("small", volume, lines, 0.033, pause_for_setup=False, overrun=overrun)


@pytest.mark.parametrize("overrun", [0.0, 0.003])
def test_the_moves_are_those_that_the_sequencer_commands(overrun):
    """The program and the live run go to the same places in the same order."""
    plan = small_plan(overrun)
    start = (0.05, 0.06, 0.07)
    moves = [Move(start, 0.0), *moves_of(plan)]
    text = nc_program(moves, feed_m_per_s=0.033, name="x", dialect=Dialect(decimals=6))
    path = np.array([place for place, _ in Controller().run(text).path][3:]) * 1e-3
    commanded = np.array(commanded_by_the_sequencer(plan, start))
    assert path.shape == commanded.shape
    assert np.max(np.abs(path - commanded)) < 1e-9


def test_an_overrun_comes_before_each_pass_and_is_no_stop():
    plain, beyond = (Controller().run(program_of(small_plan(o), load_machine("demo")[0]))
                     for o in (0.0, 0.003))  # fmt: skip
    assert [place for place, _, _ in plain.stays] == [place for place, _, _ in beyond.stays]
    xs = [place[0] for place, axes in beyond.path[3:6]]
    assert xs == [7.0, 10.0, 30.0], "beyond the first stop, back to it, on to the second"


def test_a_plan_beyond_the_machine_gets_no_program():
    machine = load_machine("demo")[0]
    volume = Volume((0.0, 0.0, 0.0), (0.1, 0.1, 0.1), 5)
    plan = Plan("too high", volume, (Line("linear", "z", "", 0, "forward"),), 0.033)
    with refused(Refusal, "out_of_range", "Z", "0", "0.5", aspect="move"):
        program_of(plan, machine)
    fast = replace(load_plan("demo")[0], feed=1.0)
    with refused(Refusal, "out_of_range", aspect="move"):
        program_of(fast, machine)
