"""A run on live nodes: what ``stepdiag watch`` writes of it against what was published.

The tests follow each other in the order in which they stand here.
"""

import signal

from patience import PATIENCE

from stepdiag_ros import topics
from stepdiag_ros.messages.volumetric import to_volumetric_errors
from stepdiag_ros.metrology.geometry import SQUARENESS
from stepdiag_ros.text.numbers import plus_minus
from stepdiag_ros.viewers.page.section import micrometres


def squareness(result):
    figures = (result.figure(name) for name in SQUARENESS)
    return [
        f"{one.name}|{plus_minus(one.value, one.standard_uncertainty, 1e6)} µm/m" for one in figures
    ]


def test_where_no_run_was_started_there_is_none_to_be_shown(cell):
    code, out, err = cell.once()
    assert code == 1
    # What nodes complain of before a run, as of a beam that is not there yet.
    assert all(line.startswith(("fault: ", "warning: ")) for line in out.splitlines())
    assert err.startswith("stepdiag: error: no run has begun: nothing is measured (")
    assert f"{len(cell.nodes)} nodes" in err and err.count("\n") == 1


def test_the_log_tells_what_was_published(cell):
    cell.measure()
    cell.wait(
        lambda: any("state: finished" in line for line in cell.logged()), "the watch has the end"
    )
    state, diagnosis = cell.said[topics.RUN_STATE][-1], cell.said[topics.DIAGNOSIS][-1]
    result = to_volumetric_errors(cell.result())

    def told():
        start = "result: Least squares, 6 passes"
        return [line for line in cell.logged() if line.startswith(start)]

    cell.wait(lambda: bool(told()), "the last result")
    for one in squareness(result):
        assert one.replace("|", " ") in told()[-1]
    verdict = f"verdict: {diagnosis.verdict}, {diagnosis.lines} of {diagnosis.lines_planned} passes"
    cell.wait(lambda: any(line.startswith(verdict) for line in cell.logged()), "the last verdict")
    lines = cell.logged()
    assert sum(line.startswith("run ") for line in lines) == 1
    assert any(line.startswith(f"run {state.run_id}, simulated: ") for line in lines)
    passes = [line for line in lines if line.startswith("line ")]
    assert len(passes) == len(cell.said[topics.LINE]) == state.line_count
    assert (
        f"state: finished: {state.text} ({state.stops_done} of {state.stops_total} stops)" in lines
    )


def test_who_comes_late_sees_the_state(cell):
    code, out, err = cell.once()
    assert code == 0 and err == ""
    text = " ".join(out.split())
    state, diagnosis = cell.said[topics.RUN_STATE][-1], cell.said[topics.DIAGNOSIS][-1]
    assert out.startswith(state.run_id) and f"{len(cell.nodes)} nodes" in out.splitlines()[0]
    assert f"finished: {state.text}" in text
    assert f"{state.stops_done} of {state.stops_total} stops" in text
    assert "Beam: good" in text
    for one in squareness(to_volumetric_errors(cell.result())):
        name, _, shown = one.partition("|")
        assert any(row.rstrip().endswith(shown) and name in row for row in out.splitlines())
    assert f"Verdict: {diagnosis.verdict}; {diagnosis.lines} of" in text
    assert diagnosis.sentence in text
    assert f"gap rms {micrometres(diagnosis.rms_before)}" in text
    assert max(map(len, out.splitlines())) <= 80


def test_who_looks_on_is_missed_by_nobody(cell):
    """Two viewers have come and gone by now, and the nodes know of none."""
    known = {one.role for one in cell.operator.watch.peers.values()}
    assert "viewer" not in known and len(cell.operator.watch.peers) == len(cell.nodes)
    assert not any("viewer node" in line for line in cell.logged())
    nodes = [name for name, _ in cell.operator.get_node_names_and_namespaces()]
    (viewer,) = (name for name in nodes if name.startswith("viewer_"))
    published = cell.operator.get_publisher_names_and_types_by_node(viewer, "/")
    # Nothing of a run, and no heartbeat.
    assert {name for name, _ in published} <= {"/rosout", "/parameter_events"}
    asked = cell.operator.get_client_names_and_types_by_node(viewer, "/")
    assert [name for name, _ in asked] == []


def test_a_lost_node_is_said_and_ctrl_c_ends(cell):
    process = cell.processes.running["weather"]
    process.kill()
    process.wait()
    cell.wait(
        lambda: any(
            line.startswith("fault: nodes: weather node /weather is silent")
            for line in cell.logged()
        ),
        "the log says that the node is silent",
    )
    assert f"{len(cell.nodes) - 1} of {len(cell.nodes)} nodes answer" in cell.logged()
    cell.watch.send_signal(signal.SIGINT)
    assert cell.watch.wait(PATIENCE) == 0
