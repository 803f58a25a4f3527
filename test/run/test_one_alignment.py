"""One alignment for all move orders of a diagonal: what the sequence pauses for."""

from dataclasses import replace

from refused import refused

from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.run.sequence import Answer, Purpose, Sequence, State

MAPPING = {
    "step_m": [0.01, 0.01, 0.01],
    "blocks": 1,
    "feed_m_per_s": 0.05,
    "pause_for_setup": True,
    "one_alignment_per_diagonal": True,
    "lines": [
        {"kind": "linear", "names": ["x"]},
        {"kind": "step_diagonal", "names": ["ppp", "npp"], "orders": ["XYZ", "YZX", "ZXY"]},
    ],
}
SECOND = 1_000_000_000


def setups_aligned(plan):
    """Run a plan on a machine that obeys at once; return every setup that it paused for."""
    sent, paused = [], []
    sequence = Sequence(plan, (0.0, 0.0, 0.0), sent.append, lambda: None)
    now = 0
    sequence.start(now, 0.0)
    for _ in range(500):
        now += SECOND
        if sequence.state is State.FINISHED:
            return paused
        if sequence.state is not State.RUNNING:
            paused.append(sequence.progress(now).setup)
            sequence.resume(now, now * 1e-9, (0.0, 0.0, 0.0))
        sequence.beam_ready(sequence.progress(now).setup)
        sequence.update(now, now * 1e-9)
        if sent:
            command = sent.pop()
            for answer in (Answer.ACCEPTED, Answer.IN_POSITION):
                sequence.answered(command.command_id, answer, "", now, now * 1e-9)
            if command.purpose is Purpose.STOP:
                sequence.settled(command.line_index, command.attempt, command.stop, "")
                sequence.stored(command.command_id)
    raise AssertionError("the run does not end")


def test_the_operator_aligns_each_diagonal_once():
    plan = Plan.from_mapping(MAPPING, "plan")
    assert setups_aligned(plan) == ["x", "ppp", "npp"]
    each = replace(plan, one_alignment_per_diagonal=False)
    assert setups_aligned(each) == [
        "x",
        *(f"{line} {order}" for line in ("ppp", "npp") for order in ("XYZ", "YZX", "ZXY")),
    ]


def test_the_key_is_true_or_false():
    with refused(Refusal, "malformed", "yes", about="one_alignment_per_diagonal"):
        Plan.from_mapping({**MAPPING, "one_alignment_per_diagonal": "yes"}, "plan")
