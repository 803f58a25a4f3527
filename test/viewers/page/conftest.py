"""The run that the page shows."""

from shown_run import small_run

__all__ = ["small_run"]
