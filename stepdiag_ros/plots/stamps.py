"""The stamp at the lower right of a figure: what it was made from."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from stepdiag_ros.bags.run import RecordedRun


def stamp(run: "RecordedRun | None" = None, *, run_id: str = "", plan: str = "") -> str:
    """Return the stamp of a run: its plan and its identity, as far as they are known.

    Args:
        run: from a bag; None: the rest tells.
        run_id: identity of the run.
        plan: its name.
    """
    if run is not None:
        run_id, plan = run.run_id, run.plan.name
    return ", ".join(part for part in (plan, f"run {run_id}" if run_id else "") if part)
