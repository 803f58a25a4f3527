"""How a node process ends."""

import sys

import pytest
import rclpy

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


def test_a_failure_before_the_end_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_Failing, "told_to_end", False)
    with pytest.raises(RuntimeError, match="context is invalid"):
        base.spin(_Failing)
    assert _Failing.last.closed
