"""A live graph whose bridge was started for another machine begins no run."""

from patience import PATIENCE
from ros_processes import domain
from running_cell import RunningCell

from stepdiag_ros import topics

__all__ = ["domain"]


def test_no_run_begins_with_another_machine_at_the_bridge(tmp_path):
    cell = RunningCell(tmp_path, [topics.MACHINE_COMMAND], plan="quick")
    cell.nodes["bridge"].parameters["machine"] = "gantry"
    refusals = []

    def refused():
        try:
            cell.operator.start()
        except ValueError as error:
            refusals.append(str(error))
        else:
            raise AssertionError("a run has begun")
        return "gantry" in refusals[-1]

    with cell:
        cell.wait(refused, f"the start is refused within {PATIENCE:g} s")
    # Both machines are named, and nothing was commanded.
    assert "demo" in refusals[-1] and "machine" in refusals[-1]
    assert not cell.said[topics.MACHINE_COMMAND]
