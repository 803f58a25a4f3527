"""How a node process ends."""

import os
import signal
import sys

import pytest
import rclpy
from rclpy.exceptions import NotInitializedException
from refused import refused

from stepdiag_ros.nodes import base


class _Failing(base.StepdiagNode):
    """Fails in a callback as a publisher does, after the process was told to end or before."""

    told_to_end = True

    def __init__(self) -> None:
        super().__init__("failing")
        self.closed = False
        _Failing.last = self
        self.every(0.01, self._fail, real=True)

    def _fail(self) -> None:
        if self.told_to_end:
            rclpy.shutdown()
        raise RuntimeError("the context is invalid")

    def close(self) -> None:
        self.closed = True


@pytest.fixture(autouse=True)
def _no_arguments(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["node"])


def test_a_callback_cut_short_by_the_end_is_no_failure() -> None:
    assert base.spin(_Failing) == 0
    assert _Failing.last.closed


class _ToldWhileItStarts(base.StepdiagNode):
    """Is told to end while it is being made; what it makes after that is refused by rclpy."""

    role = "solver"
    signal = True

    def __init__(self) -> None:
        super().__init__("starting")
        if self.signal:
            rclpy.shutdown()
        raise NotInitializedException


def test_to_be_told_to_end_while_starting_is_no_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    assert base.spin(_ToldWhileItStarts) == 0
    monkeypatch.setattr(_ToldWhileItStarts, "signal", False)
    with pytest.raises(NotInitializedException):
        base.spin(_ToldWhileItStarts)
    rclpy.try_shutdown()


class _ToldBeforeItSpins(base.StepdiagNode):
    """Is told to end between its making and its first callback."""

    role = "solver"
    number = signal.SIGTERM

    def __init__(self) -> None:
        super().__init__("before")
        self.closed = False
        _ToldBeforeItSpins.last = self
        os.kill(os.getpid(), self.number)

    def close(self) -> None:
        self.closed = True


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_to_be_told_to_end_before_it_spins_is_no_failure(
    monkeypatch: pytest.MonkeyPatch, number: signal.Signals
) -> None:
    monkeypatch.setattr(_ToldBeforeItSpins, "number", number)
    # Ctrl-C raises at once, in the middle of the making; SIGTERM ends the context alone.
    assert base.spin(_ToldBeforeItSpins) == 0
    assert _ToldBeforeItSpins.last.closed == (number == signal.SIGTERM)


class _ToldTwice(base.StepdiagNode):
    """Is told to end again while it closes, as by ros2 launch after the terminal's own Ctrl-C."""

    role = "solver"

    def __init__(self) -> None:
        super().__init__("twice")
        self.closed = False
        _ToldTwice.last = self
        self.every(0.01, lambda: os.kill(os.getpid(), signal.SIGINT), real=True)

    def close(self) -> None:
        for number in (signal.SIGINT, signal.SIGTERM):
            os.kill(os.getpid(), number)
        self.closed = True


def test_a_second_request_to_end_does_not_cut_the_closing_short() -> None:
    assert base.spin(_ToldTwice) == 0
    assert _ToldTwice.last.closed
    os.kill(os.getpid(), signal.SIGINT)


def test_a_failure_before_the_end_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_Failing, "told_to_end", False)
    with refused(RuntimeError, None, "context"):
        base.spin(_Failing)
    assert _Failing.last.closed
