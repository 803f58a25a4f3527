"""The driver of Grbl in front of a controller that fails, is touched by others, or falls silent."""

import re
import time
from dataclasses import replace

import pytest
from grbl_rig import MACHINE, GrblPeer, operator_of
from patience import PATIENCE
from refused import a_fault, refused
from ros_processes import wait_until

from stepdiag_ros.devices import Surroundings, prepare
from stepdiag_ros.devices.cnc import CncState, MoveRefused
from stepdiag_ros.metrology.refusal import Refusal

FAR = (0.05, 0.0, 0.0)


@pytest.fixture
def peers():
    made = []

    def make(**settings):
        made.append(GrblPeer(**settings))
        return made[-1]

    yield make
    for peer in made:
        peer.close()


@pytest.fixture
def peer(peers):
    return peers()


def moving(peer, feed=0.05, **changed):
    """Return an operator whose machine is on its way to ``FAR``."""
    operator = operator_of(peer, **changed).ready()
    operator.move(FAR, "X", feed)
    operator.until(lambda: operator.position[0] > 2e-3)
    return operator


def fault(operator):
    return operator.until_state(CncState.FAULT).reason


def fails(operator, error, words):
    with refused(error, words):
        operator.watch(PATIENCE)


def test_it_asks_for_everything_before_it_is_ready_and_moves_nothing(peer):
    operator = operator_of(peer)
    assert operator.device.state is CncState.FAULT
    assert not operator.device.traits.measured
    with refused(MoveRefused, "busy"):
        operator.move(FAR, "X")
    operator.ready()
    assert peer.received == ["$I", "$$", "$N"]
    assert operator.device.traits.acceleration == pytest.approx((2.0, 2.0, 2.0))
    assert peer.made == []


def test_each_step_is_one_line_in_machine_coordinates(peer):
    peer.wco = [5.0, -7.0, 1.0]
    peer.settings[10] = 2
    operator = operator_of(peer).ready()
    assert operator.position == pytest.approx((0.0, 0.0, 0.0))
    # Modes that somebody else has left behind.
    peer._modes |= {"inches": True, "relative": True, "motion": 0}
    for step in range(1, 4):
        operator.moved((step * 2e-3, (step - 1) * 1e-3, 0.0), "X")
        operator.moved((step * 2e-3, step * 1e-3, 0.0), "Y")
    assert peer.received[3:5] == ["G90G94G21G53G1X2F3000", "G90G94G21G53G1Y1F3000"]
    # Each target once, and nothing else.
    assert peer.made == [
        (2.0, 0.0, 0.0), (2.0, 1.0, 0.0), (4.0, 1.0, 0.0),
        (4.0, 2.0, 0.0), (6.0, 2.0, 0.0), (6.0, 3.0, 0.0),
    ]  # fmt: skip
    assert operator.position == pytest.approx((6e-3, 3e-3, 0.0))


def test_reports_in_inches_are_read(peers):
    operator = operator_of(peers(_13=1)).ready()
    operator.moved((0.0254, 0.0, 0.0), "X", 0.2)
    assert operator.position == pytest.approx((0.0254, 0.0, 0.0), abs=1.3e-6)


def test_a_coarse_step_widens_the_window_and_is_told(peers):
    operator = operator_of(peers(_100=80.0)).ready()
    assert operator.device.traits.resolution[0] == pytest.approx(12.5e-6)
    operator.moved((0.0100060, 0.0, 0.0), "X")
    assert operator.device.state is CncState.READY


def test_a_move_faster_than_the_controller_allows_is_refused(peers):
    operator = operator_of(peers(_110=600.0)).ready()
    with refused(MoveRefused, "out_of_range", "X", "0.01", "m/s", "$110", aspect="fastest"):
        operator.move(FAR, "X", 0.02)
    with refused(MoveRefused, "out_of_range", aspect="slowest"):
        operator.move(FAR, "X", 1e-6)


def test_an_error_is_a_fault_in_words_and_nothing_moves(peer):
    operator = operator_of(peer).ready()
    peer._execute = lambda _: "error:20"
    operator.move(FAR, "X")
    assert (
        fault(operator) == "the controller refused the move: error 20: it does not know this G-code"
    )
    operator.reset()
    assert operator.device.state is CncState.READY
    assert peer.made == []


@pytest.mark.parametrize(
    ("byte", "words"),
    [(ord("!"), "feed hold at the machine"), (0x84, r"the safety door was opened \(inputs D\)")],
)
def test_who_holds_the_machine_ends_the_step_and_it_is_never_resumed(peer, byte, words):
    operator = moving(peer)
    peer.do("press", byte)
    reason = operator.until_state(CncState.STOPPED).reason
    assert re.fullmatch(words, reason)
    where = operator.position
    if byte == 0x84:
        with refused(MoveRefused, "not_ready", aspect="door"):
            operator.device.reset(time.time_ns())
        peer.door_open = False
        peer._state = "Door:0"
    operator.watch(0.1)
    operator.reset()
    operator.watch(0.3)
    assert operator.device.state is CncState.READY
    assert operator.position == where
    assert peer.made == [(50.0, 0.0, 0.0)]
    operator.moved((0.0, 0.0, 0.0), "X", 0.2)


def test_an_alarm_out_of_the_blue_is_a_fault_and_needs_an_operator(peer):
    operator = moving(peer)
    peer.pins = "X"
    peer.do("alarm", 1)
    assert fault(operator) == "alarm 1: a limit switch was hit"
    # It is locked, and answers nothing but a reset: that is no silence.
    operator.watch(1.3)
    peer.pins = ""
    operator.reset()
    assert operator.device.state is CncState.READY
    assert peer.received[-1] == "$X"


def test_a_lost_position_is_not_unlocked_but_homed(peers):
    peer = peers(_22=1, _27=2.0)
    operator = operator_of(peer, without_homing=False)
    operator.until(lambda: operator.changes and "locked" in operator.changes[-1].reason)
    with refused(MoveRefused, "undetermined", aspect="position"):
        operator.device.reset(time.time_ns())
    operator.until(lambda: len(peer.received) == 3)
    operator.watch(0.2)
    assert peer.received == ["$I", "$$", "$N"]
    operator.device.close()
    operator = operator_of(peer, without_homing=False, home_on_reset=True)
    operator.until(lambda: operator.changes and "locked" in operator.changes[-1].reason)
    operator.reset()
    assert operator.device.state is CncState.READY
    assert operator.samples[-1].position == pytest.approx((-2e-3, -2e-3, -2e-3))
    assert "$H" in peer.received and "$X" not in peer.received


def test_stop_ends_homing(peers):
    peer = peers(_22=1)
    operator = operator_of(peer, without_homing=False, home_on_reset=True)
    operator.until(lambda: operator.changes and "locked" in operator.changes[-1].reason)
    with refused(MoveRefused, "busy", aspect="homing"):
        operator.device.reset(time.time_ns())
    operator.watch(0.05)
    operator.device.stop(time.time_ns(), "operator")
    operator.until(lambda: "alarm 6" in operator.changes[-1].reason)
    assert operator.device.state is CncState.FAULT


def test_a_restart_in_the_middle_of_a_step_is_a_fault_and_loses_the_position(peer):
    operator = moving(peer)
    peer.do("power_cycle")
    assert "the controller was restarted" in fault(operator)
    operator.until(lambda: operator.position == (0.0, 0.0, 0.0))
    assert operator.device.state is CncState.FAULT
    operator.watch(0.3)
    assert peer.made == [(50.0, 0.0, 0.0)]
    with refused(MoveRefused, "not_ready", "fault", aspect="state"):
        operator.move((0.001, 0.0, 0.0), "X")
    # Its zero is another one now, and an operator must say that this is known.
    with refused(MoveRefused, "busy", aspect="unlocking"):
        operator.device.reset(time.time_ns())


@pytest.mark.parametrize(("code", "kept"), [(1, False), (2, True), (3, False), (9, False)])
def test_which_alarms_an_operator_may_unlock(peers, code, kept):
    peer = peers(_22=1)
    peer._state = "Idle"
    operator = operator_of(peer, without_homing=False).ready()
    peer.do("alarm", code)
    fault(operator)
    if kept:
        operator.reset()
        assert operator.device.state is CncState.READY
    else:
        with refused(MoveRefused, "undetermined", str(code), aspect="position"):
            operator.reset(1.0)
        assert "$X" not in peer.received


def test_a_reset_in_the_middle_of_a_step_tells_the_alarm(peer):
    operator = moving(peer)
    peer.do("reset_button")
    assert fault(operator).startswith("alarm 3: it was reset while the axes moved")
    operator.watch(0.3)
    assert operator.device.state is CncState.FAULT


def test_moves_of_somebody_else_are_a_fault(peer):
    operator = operator_of(peer).ready()
    peer.do("jog", 3.0)
    assert fault(operator) == "the machine is jogged by somebody else"
    operator.until(lambda: operator.position[0] > 2.9e-3)
    operator.watch(0.2)
    operator.reset()
    assert operator.device.state is CncState.READY


def test_a_controller_in_motion_is_not_taken_over(peer):
    peer.do("jog", 8.0)
    operator = operator_of(peer)
    assert fault(operator).startswith("the controller is asked")
    operator.until(lambda: "jogged by somebody" in operator.changes[-1].reason)
    with refused(MoveRefused, "busy", aspect="motion"):
        operator.device.reset(time.time_ns())
    assert peer.received == []
    operator.until_state(CncState.READY)


def test_a_step_that_ends_somewhere_else_is_a_fault(peer):
    operator = operator_of(peer).ready()
    peer._execute = lambda _: "ok"
    operator.move(FAR, "X")
    assert (
        fault(operator) == "the controller is idle at 0.000, 0.000, 0.000 mm, away from the target"
    )


def test_a_machine_that_stands_still_in_a_step_is_a_fault_and_held(peer):
    operator = moving(peer)
    peer._move = lambda _: None
    assert "have stood for 3 s away from the target" in fault(operator)
    operator.until(lambda: peer._state == "Hold:1")


def test_a_hold_that_does_not_brake_is_followed_by_a_kill(peer):
    operator = moving(peer, 0.02, machine=replace(MACHINE, feed_limit_m_per_s=0.1))
    peer._real_time = lambda byte, act=peer._real_time: act(byte) if byte != ord("!") else None
    operator.device.stop(time.time_ns(), "operator")
    assert fault(operator).startswith("alarm 3")
    assert peer.position[0] < 50.0


def test_silence_is_an_error_in_time(peer):
    operator = moving(peer)
    peer.mute = True
    fails(operator, OSError, a_fault("silent", "1"))


def test_nobody_there_is_an_error_in_time(peer):
    peer.mute = True
    fails(operator_of(peer), OSError, a_fault("silent", "2"))


def test_a_lost_answer_is_an_error_and_the_step_is_not_made_twice(peer):
    operator = operator_of(peer).ready()
    peer.answers = False
    operator.move((0.001, 0.0, 0.0), "X")
    fails(operator, OSError, a_fault("undetermined", "G90G94G21G53G1X1F3000", aspect="answer"))
    operator.device.close()
    peer.answers = True
    operator = operator_of(peer).ready()
    operator.watch(0.3)
    assert peer.made == [(1.0, 0.0, 0.0)]
    assert operator.position == pytest.approx((1e-3, 0.0, 0.0))


def test_reports_that_fail_now_and_then_do_no_harm(peer):
    operator = operator_of(peer).ready()
    count = [0]

    def lose(data):
        """Every third report is lost, damaged, cut, or of noise."""
        count[0] += 1
        if data[:1] != b"<" or count[0] % 3:
            return data
        kind = count[0] // 3 % 4
        return (b"", data[:12] + b"\r\n", data.replace(b"MPos:", b"MPos:9"), b"\xff\x00\x80")[kind]

    peer.garble = lose
    operator.moved((0.01, 0.0, 0.0), "X")
    assert operator.device.state is CncState.READY
    assert operator.position == pytest.approx((0.01, 0.0, 0.0))
    assert all(sample.position[0] < 0.0101 for sample in operator.samples)


def test_nonsense_alone_is_refused(peer):
    operator = operator_of(peer).ready()
    peer.garble = lambda _: b"\xfe\x12x%\r\n" * 4
    fails(operator, ValueError, a_fault("malformed"))
    operator = operator_of(peer)
    peer.garble = lambda _: b"x" * 700
    fails(operator, ValueError, a_fault("too_many"))


def test_a_position_that_insists_on_a_jump_is_a_fault(peer):
    operator = operator_of(peer).ready()
    # So far that axes at full feed do not cover it while a busy computer lets the driver wait.
    peer.position = [9e4, 0.0, 0.0]
    assert "the position jumped" in fault(operator)


def test_a_broken_link_is_an_error_and_the_device_can_be_opened_anew(peer):
    operator = moving(peer)
    peer.do("hang_up")
    fails(operator, OSError, a_fault("lost", aspect="link"))
    operator.device.close()
    # The machine finishes the one line that it has; it is watched, and nothing is sent again.
    operator = operator_of(peer)
    operator.until_state(CncState.READY)
    operator.until(lambda: operator.position == pytest.approx(FAR))
    assert peer.made == [(50.0, 0.0, 0.0)]
    assert peer.connections == 2


def test_a_controller_held_by_a_link_that_broke_is_reset_by_an_operator(peer):
    operator = moving(peer)
    operator.device.stop(time.time_ns(), "the node ends")
    operator.device.close()
    assert wait_until(lambda: peer._state == "Hold:0")
    operator = operator_of(peer)
    operator.until(lambda: operator.changes[-1].reason == "feed hold at the machine")
    operator.watch(0.2)
    assert peer._state == "Hold:0"
    operator.reset()
    assert operator.device.state is CncState.READY
    operator.until(lambda: operator.position is not None)
    assert operator.position[0] < 0.049


@pytest.mark.parametrize(("startup", "words"), [("G0X5", a_fault("rejected")), ("G54", "")])
def test_start_up_blocks(peer, startup, words):
    peer.startup[0] = startup
    operator = operator_of(peer)
    if words:
        fails(operator, ValueError, words)
    else:
        operator.ready()


def test_it_needs_a_machine():
    with refused(Refusal, "missing", about="machine"):
        prepare("cnc", "grbl", {"connection": {"url": "loop://"}}, Surroundings())
