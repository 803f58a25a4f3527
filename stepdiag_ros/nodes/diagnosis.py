#!/usr/bin/env python3
"""Node: compares the lines of a run with a model of the machine while they are measured."""

import sys
from concurrent.futures import Future
from typing import Any

from stepdiag_ros import topics
from stepdiag_ros.configuration import chain_from_text, load_model, plan_from_text
from stepdiag_ros.evaluation.diagnosing import diagnose_lines, when_over
from stepdiag_ros.messages.diagnosis import from_diagnosis
from stepdiag_ros.metrology.discrepancy.extension import with_chain
from stepdiag_ros.metrology.discrepancy.summary import NOT_DIAGNOSED, DiagnosisSummary
from stepdiag_ros.metrology.measurement import Measurement, latest_attempts
from stepdiag_ros.metrology.model import MachineModel
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.metrology.solvers.limits import DIAGNOSIS, left_out
from stepdiag_ros.nodes.background import BackgroundProcess, WorkFailed
from stepdiag_ros.nodes.base import spin
from stepdiag_ros.nodes.lines import LineNode
from stepdiag_ros.run.health import HealthFinding
from stepdiag_ros.run.supervision import WORK_LEFT
from stepdiag_ros.run.work_health import Work

LOOK_PERIOD = 0.02
"""Real seconds between two looks at what has been diagnosed."""


class DiagnosisNode(LineNode):
    """Publishes whether the lines so far agree with the model, and if not, what is missing.

    A diagnosis takes seconds, so that it is made in a process of its own. It wants all lines there
    are: one is made at a time, and lines that come meanwhile are taken up by the next. How many are
    made in a run depends on the speed of the computer; the one that is published when the run is
    over depends on the lines alone.
    """

    role = "diagnosis"

    def __init__(self) -> None:
        super().__init__("diagnosis")
        self._model, self._model_text = load_model(self.parameter("model"))
        self.on_change("model", self._take_model, self._another_model)
        self.on_change("seed", prepare=self._when_done)
        self._background = BackgroundProcess()
        self._plan: Plan
        self._chain = ""
        self._task: Future[DiagnosisSummary] | None = None
        self._task_lines = 0
        self._too_large = False
        self._ended = -self._pause
        # Of the present run: how many lines were compared last, and what came of it.
        self._compared = 0
        self._summary: DiagnosisSummary | None = None
        self._told_last = False
        self._diagnoses = self.announce(topics.DIAGNOSIS)
        self.facts[WORK_LEFT] = "0"
        self._work = Work("comparison")
        self.health.add_task("work", self._judge_work)
        self.follow_lines()
        self.every(LOOK_PERIOD, self._look, real=True)

    @property
    def _pause(self) -> float:
        return float(self.parameter("pause_s"))

    def _another_model(self, name: str) -> tuple[MachineModel, str]:
        return load_model(self._when_done(name))

    def _take_model(self, loaded: tuple[MachineModel, str]) -> None:
        self._model, self._model_text = loaded

    def _when_done(self, value: Any) -> Any:
        """Refuse to change what the last diagnosis of a run, which is still to come, is made by."""
        if self.facts[WORK_LEFT] != "0":
            raise ValueError(f"run {self.run_id} is still being diagnosed: wait for its end")
        return value

    def take_up(self, description: Any) -> None:
        """Start again; a diagnosis of the run before is dropped."""
        plan = plan_from_text(description.plan, "plan of the run")
        self._chain = chain_from_text(description.machine, "machine of the run")
        with_chain(Measurement(plan.volume, (), self._chain), self._model)
        self._plan, self._task, self._task_lines = plan, None, 0
        self._compared, self._summary, self._told_last = 0, None, False
        self._ended = self.real_time() - self._pause
        self.facts.pop("verdict", None)
        self._say_if_too_large()

    def _say_if_too_large(self) -> None:
        """Say that a run will not be diagnosed because of its size, before its first line."""
        plan = self._plan
        reasons = {} if plan.tracker else left_out(plan.volume.blocks, plan.stop_count)
        self._too_large = DIAGNOSIS in reasons
        if self._too_large:
            self.facts["verdict"] = f"{NOT_DIAGNOSED}: {reasons[DIAGNOSIS]}"
            self.get_logger().warning(f"the diagnosis is {reasons[DIAGNOSIS]}")

    def close(self) -> None:
        """Let go of what is not diagnosed yet."""
        self._background.end()

    def on_run_end(self) -> None:
        """Say that the last diagnosis is still to come, before the bag is closed."""
        self._look()

    def _look(self) -> None:
        """Publish what is done, begin what is due, and say how much is left."""
        if self._task is not None and self._task.done():
            task, self._task = self._task, None
            self._work.end(self.real_time())
            self._compared, self._ended = self._task_lines, self.real_time()
            self._summary = self._result_of(task)
            self._told_last = False
            if self._summary is not None:
                self._publish(self._summary)
        new = len(self.lines) > self._compared and not self._too_large
        rested = self.run_over or self.real_time() - self._ended >= self._pause
        if self._task is None and new and rested:
            self._begin()
        if self.run_over and self._task is None and self._summary and not self._told_last:
            self._publish(self._summary)
        self._say_work_left(new)

    def _begin(self) -> None:
        lines = latest_attempts(tuple(self.lines))
        measurement = Measurement(self._plan.volume, lines, self._chain)
        self._task = self._background.submit(
            diagnose_lines, measurement, self._plan, self._model_text, self.parameter("seed")
        )
        self._task_lines = len(self.lines)
        self._work.begin(self.real_time())

    def _judge_work(self) -> HealthFinding:
        return self._work.judge(int(self.facts[WORK_LEFT]), len(self.lines))

    def _result_of(self, task: "Future[DiagnosisSummary]") -> DiagnosisSummary | None:
        try:
            summary = task.result()
        except ValueError as error:
            self.unwell(f"the lines cannot be diagnosed: {error}")
            return None
        except WorkFailed as error:
            # An effect may be of another package; the measurement goes on whatever that does.
            self.get_logger().error(str(error))
            self.unwell(f"the diagnosis has failed: {str(error).splitlines()[-1]}")
            return None
        if not self.run_over:
            self.healthy(f"run {self.run_id}")
        return summary

    def _publish(self, summary: DiagnosisSummary) -> None:
        over = self.run_over and self._compared == len(self.lines)
        self._told_last = over
        shown = when_over(summary) if over else summary
        self.facts["verdict"] = shown.words
        self._diagnoses.publish(from_diagnosis(shown, self.run_id))
        self.get_logger().info(shown.words)

    def _say_work_left(self, new: bool) -> None:
        left = "1" if new or self._task is not None else "0"
        if self.facts[WORK_LEFT] != left:
            self.facts[WORK_LEFT] = left
            self.beat()


def main() -> int:
    """Run the node."""
    return spin(DiagnosisNode)


if __name__ == "__main__":
    sys.exit(main())
