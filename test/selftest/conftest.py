"""What the tests of the self-test share: the same problems are judged right and then broken."""

from kept_verdicts import kept_verdicts

__all__ = ["kept_verdicts"]
