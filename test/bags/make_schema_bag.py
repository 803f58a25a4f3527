"""Makes ``test/data/bags/schema_N.mcap``: run once for each new schema version, never again."""

import sys
from pathlib import Path

import numpy as np
from bags_for_tests import RUN_ID, START, description, header, put

from stepdiag_ros import topics
from stepdiag_ros.bags.types import own_types
from stepdiag_ros.bags.writer import BagWriter
from stepdiag_ros.messages import conversion
from stepdiag_ros.messages.diagnosis import from_diagnosis
from stepdiag_ros.messages.positioning import from_positioning_test
from stepdiag_ros.messages.samples import from_sample_block
from stepdiag_ros.messages.volumetric import from_volumetric_errors
from stepdiag_ros.metrology.discrepancy.findings import RunnerUp, Share
from stepdiag_ros.metrology.discrepancy.summary import (
    DiagnosisSummary,
    FoundEffect,
    FoundSize,
    GapFigures,
    Limit,
    ModelSource,
)
from stepdiag_ros.metrology.geometry import CURVES
from stepdiag_ros.metrology.measurement import (
    BlockDisplacement,
    Environment,
    MeasuredLine,
    Reading,
    SettledStop,
    StopCommand,
)
from stepdiag_ros.metrology.plan import Line
from stepdiag_ros.metrology.samples import SampleBlock
from stepdiag_ros.metrology.solvers.result import Figure, VolumetricErrors
from stepdiag_ros.metrology.standards.iso230_2 import PositioningTest

NEW = own_types().new
AIR = Environment(20.0, 101325.0, 0.5, 20.5)
X = Line("linear", "x", "", 0, "forward", (0.0, 0.02, 0.0))
TARGET, ACTUAL = (0.01, 0.0, 0.0), (0.0100001, 0.0, 0.0)
COMMAND = StopCommand(1, 0, 1, X.setup, 1, "X", TARGET, START)


def diagnosis():
    """Make a diagnosis that has something in every field."""
    found = FoundEffect(
        label="backlash of X",
        effect="backlash",
        setting={"axis": "X"},
        sentence="lost motion at reversal",
        source="ISO 230-2",
        sizes=(FoundSize("lost_motion", "m", "width", 8e-7, 1e-8, (7.8e-7, 8.2e-7)),),
        gain=52.25,
        p_value=0.0005,
        probability=0.98,
        ambiguous_with=("backlash of Y",),
        runners_up=(
            RunnerUp("backlash of Y", 50.5, 0.01, "closes less", ambiguous=True),
            RunnerUp("drift", 5.5, 0.001, "closes less"),
        ),
    )
    return DiagnosisSummary(
        time=START,
        run_over=True,
        lines=1,
        lines_planned=3,
        verdict="AMBIGUOUS",
        sentence="by hand",
        findings=(found,),
        partial=(),
        covariance=(1e-16,),
        noise=1e-7,
        noise_degrees_of_freedom=120.0,
        noise_correlation=0.25,
        noise_source="differences of repeats",
        before=GapFigures(150.5, 100, 0.001, 2e-7, 5e-7),
        after=GapFigures(98.5, 99, np.nan, 1e-7, 3e-7),
        where=("on x",),
        where_after=(),
        map=(Share("line", "x", 1e-8, 2e-7, 26, 0.5),),
        detection_limits=(Limit("backlash", "backlash of Y", 1, "lost_motion", "m", 6e-8, 6e-8),),
        not_testable=("drift: the run is too short.",),
        tested=12,
        model=ModelSource("by hand", "name: by hand\n", "0" * 64),
        seed=7,
        software_version="0.1.0",
        remarks=("2 of the plan's 3 lines are not among them: y, z.",),
    )


def messages():
    """Make one message of every topic that a bag holds."""
    made = {topic: NEW(topic.type_name) for topic in topics.RECORDED}
    made[topics.RUN_DESCRIPTION] = description()
    state = made[topics.RUN_STATE]
    state.run_id, state.state, state.text = RUN_ID, 4, "finished"
    made[topics.MACHINE_COMMAND] = conversion.from_stop_command(
        COMMAND, RUN_ID, START, 0.05, new=NEW
    )
    made[topics.COMMAND_STATUS] = conversion.from_command_status(
        1, RUN_ID, START, conversion.STATUS_IN_POSITION, TARGET, ACTUAL, new=NEW
    )
    made[topics.READING] = conversion.from_reading(
        Reading(START, 1, 0.01, 0.0100002, 0.9, 0, AIR, trigger=7), "laser", NEW
    )
    samples = SampleBlock(
        time=START,
        sequence=50,
        period=2e-5,
        zero=3,
        scale=0.99973,
        offset=1.5e-7,
        environment=AIR,
        raw_displacement=np.array([0.01, 0.0100001, 0.0100002]),
        signal_strength=np.array([0.9, 0.8, 0.7], dtype=np.float32),
        status=np.array([0, 0, 1], dtype=np.uint8),
    )
    made[topics.SAMPLES] = from_sample_block(samples, "laser", 50, NEW)
    stop = SettledStop(
        command=COMMAND,
        line=X,
        position=ACTUAL,
        settled=True,
        reason="",
        time=START,
        displacement=0.0100003,
        raw_displacement=0.01,
        standard_uncertainty=1e-8,
        standard_deviation=1e-7,
        readings=300,
        first_sequence=1,
        last_sequence=300,
        in_position_time=START,
        window_start=START,
        window_end=START,
        environment=AIR,
    )
    made[topics.STOP] = conversion.from_settled_stop(stop, RUN_ID, NEW)
    block = BlockDisplacement(0, 1, X, START, 1, "X", 0, 1, 0.01, 0.0100004, 1e-8)
    made[topics.BLOCK] = conversion.from_block(block, RUN_ID, NEW)
    line = MeasuredLine(
        line=X,
        line_index=0,
        attempt=1,
        setup=X.setup,
        time=np.arange(3.0),
        end_time=START,
        target=np.array([[0.0, 0.02, 0.0], [0.01, 0.02, 0.0], [0.02, 0.02, 0.0]]),
        displacement=np.array([0.0, 0.0100005, 0.0200006]),
        standard_uncertainty=np.full(3, 1e-8),
        environment=np.tile(AIR, (3, 1)),
        overrun=0.002,
    )
    made[topics.LINE] = conversion.from_measured_line(line, RUN_ID, NEW)
    curves = {name: np.array([0.0, 1.25e-6, 2.5e-6]) for name in CURVES}
    curves["E_XX"] = np.full(3, np.nan)
    result = VolumetricErrors(
        method="least_squares",
        nodes=(np.arange(3) * 0.01, np.arange(3) * 0.02, np.arange(3) * 0.03),
        curves=curves,
        standard_uncertainty={name: np.full(3, 1e-8) for name in CURVES},
        figures=(Figure("C0Y", -1.5e-6, 1e-7, "rad"),),
        lines=1,
        chi_squared=1.0,
        degrees_of_freedom=2,
    )
    made[topics.VOLUMETRIC_ERRORS] = from_volumetric_errors(result, RUN_ID, START, NEW)
    test = PositioningTest(
        name="X",
        kind="linear",
        setup=X.setup,
        target=np.array([0.0, 0.01, 0.02]),
        runs=(2, 1),
        mean_forward=np.array([0.0, 1.5e-6, 2.5e-6]),
        mean_backward=np.array([0.5e-6, 1.0e-6, 3.5e-6]),
        deviation_forward=np.full(3, 1e-7),
        deviation_backward=np.full(3, np.nan),
        parameters={"E": 3.5e-6, "R": np.nan},
        expanded_uncertainty={"E": np.nan, "R": np.nan},
        remarks=("by hand",),
    )
    made[topics.POSITIONING_TEST] = from_positioning_test(test, RUN_ID, START, NEW)
    made[topics.DIAGNOSIS] = from_diagnosis(diagnosis(), RUN_ID, NEW)
    verdict = made[topics.RUN_VERDICT]
    verdict.run_id, verdict.run_over, verdict.lines, verdict.lines_planned = RUN_ID, True, 1, 1
    verdict.outcome, verdict.conformity, verdict.diagnosis = 1, 1, 3
    verdict.worst_error, verdict.expanded_uncertainty = 7.3e-6, 1.0e-6
    verdict.coverage_factor, verdict.tolerance = 1.96, 2e-5
    verdict.worst_place, verdict.method = np.array([0.03, 0.06, 0.1]), "least_squares"
    verdict.not_determined = ["E_XX"]
    status = NEW("diagnostic_msgs/msg/DiagnosticStatus")
    status.name, status.message = "assembler", "ok"
    made[topics.DIAGNOSTICS].status = [status]
    return made


def main(path: Path) -> None:
    """Write the bag."""
    with BagWriter(path, header()) as bag:
        for topic, message in messages().items():
            put(bag, topic, message, START)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
