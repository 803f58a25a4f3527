"""A run on the fly: the machine stays at the ends of a line, and a line counts as one."""

from dataclasses import replace

from test_sequence import Rig, a_plan

from stepdiag_ros.metrology.on_the_fly.record import PassFault
from stepdiag_ros.metrology.plan import ON_THE_FLY
from stepdiag_ros.run.sequence import Answer, State


def a_rig():
    rig = Rig(replace(a_plan(), measurement=ON_THE_FLY))
    rig.start()
    return rig


def arrive(rig):
    rig.answer(Answer.ACCEPTED)
    rig.answer(Answer.IN_POSITION)


def decide(rig, *rejections):
    """Let the assembler decide all stops of the present line."""
    command = rig.sent[-1]
    for stop in range(command.stop + 1):
        rejection = rejections[0] if rejections and stop == 1 else ""
        rig.sequence.settled(command.line_index, command.attempt, stop, rejection)
    rig.sequence.stored(command.command_id)
    rig.wait(0.6)


def fly(rig):
    """Go from the first stop of a line to its last."""
    first = rig.sent[-1]
    arrive(rig)
    assert rig.sent[-1] is first  # the zero is read at rest
    rig.wait(0.6)
    stops = len(rig.sequence._stops[first.line_index])
    for stop in range(1, stops):
        assert rig.sent[-1].stop == stop
        arrive(rig)
    return rig.sent[-1]


def test_corners_are_passed_and_ends_waited_for():
    rig = a_rig()
    last = fly(rig)
    rig.wait(0.6)
    assert rig.sent[-1] is last  # until the line is decided and on the disk
    decide(rig)
    rig.align()
    assert rig.sent[-1].line_index == 1
    while rig.sent[-1].stop or rig.sent[-1].purpose.name == "POSITION":
        rig.obey()
    fly(rig)
    decide(rig)
    assert rig.sequence.state is State.FINISHED
    assert rig.sequence.incomplete == []


def test_one_rejected_corner_begins_the_line_again():
    rig = a_rig()
    fly(rig)
    decide(rig, "the beam was lost in move 1")
    rig.align()
    while rig.sent[-1].purpose.name == "POSITION":
        rig.obey()
    assert (rig.sent[-1].line_index, rig.sent[-1].attempt, rig.sent[-1].stop) == (0, 2, 0)
    fly(rig)
    decide(rig, "the beam was lost in move 1")
    assert rig.sequence.state is State.FAULT


def test_without_positions_the_machine_stays_at_every_corner():
    rig = a_rig()
    fly(rig)
    decide(rig, f"{PassFault.NO_POSITIONS.value}: every 100 ms")
    rig.align()
    assert rig.sequence.state is State.RUNNING
    while rig.sent[-1].purpose.name == "POSITION":
        rig.obey()
    for stop in range(2):
        sent = rig.sent[-1]
        assert (sent.attempt, sent.stop) == (2, stop)
        arrive(rig)
        rig.wait(0.6)
        assert rig.sent[-1] is sent
        rig.settle()
        rig.wait(0.6)
