"""A simulated cell with one run, a watch that logs it, and an operator who hears all of it."""

import os
import subprocess
import sys

from running_cell import RunningCell, fixture_of

from stepdiag_ros import topics
from stepdiag_ros.run.sequence import State

KEPT = (topics.STOP, topics.LINE, topics.VOLUMETRIC_ERRORS, topics.DIAGNOSIS, topics.RUN_STATE)
WATCH = (sys.executable, "-m", "stepdiag_ros.cli", "watch")


class WatchedCell(RunningCell):
    """The cell; what was said, and what a watch has written of it."""

    def __init__(self, folder):
        super().__init__(folder, KEPT)
        self._log = (folder / "watch.log").open("w")
        self.watch = subprocess.Popen(
            WATCH,
            stdout=self._log,
            stderr=subprocess.PIPE,
            text=True,
        )

    def __exit__(self, *arguments):
        self.processes.end()
        if self.watch.poll() is None:
            self.watch.kill()
        self.watch.communicate()
        self._log.close()
        super().__exit__(*arguments)

    def last_words(self):
        return "\n".join(self.logged()[-20:])

    def logged(self):
        """Return the lines of the watch, without the time."""
        lines = (self.folder / "watch.log").read_text().splitlines()
        return [line.partition(" ")[2] for line in lines]

    def measure(self):
        """Start the run and follow it to the end of all that is evaluated."""
        self.operator.start()

        def go_on():
            if self.state() is State.WAITING_FOR_SETUP:
                self.operator.call("sequencer/resume")
            return self.state() is State.FINISHED

        self.wait(go_on, "the run is finished")
        last = self.said[topics.RUN_STATE][-1]
        self.wait(
            lambda: (
                any(one.run_over for one in self.said[topics.DIAGNOSIS])
                and len(self.said[topics.STOP]) == last.stops_total
                and self.result().lines == last.line_count
            ),
            "all of the run is heard",
        )

    def result(self):
        """Return the newest result by least squares."""
        found = [
            one for one in self.said[topics.VOLUMETRIC_ERRORS] if one.method == "least_squares"
        ]
        return found[-1]

    def once(self, *arguments):
        """Look on once, as somebody who comes late; return exit code, output, errors."""
        done = subprocess.Popen(
            [*WATCH, "--once", *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=os.environ | {"COLUMNS": "80"},
        )
        # Who is looked at is heard by this process meanwhile.
        self.wait(lambda: done.poll() is not None, "the view is printed")
        return done.returncode, *done.communicate()


cell = fixture_of(WatchedCell)
