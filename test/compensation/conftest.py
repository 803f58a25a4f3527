"""What the tests of all compensation share."""

from kept_verdicts import kept_results, kept_verdicts

__all__ = ["kept_results", "kept_verdicts"]
