"""Time of ``stepdiag report`` of a bag, part by part, as JSON.

Wall time of the whole command in a fresh process (its drawing runs in a second one), median of
several; and the processor time of its parts in one process, one after another.

    python benchmarks/report_stages.py RUN.mcap [--runs 5]

The bar is 10 s for the run of ``stepdiag demo`` (748 stops) on two cores that do nothing else.
"""

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from functools import partial
from pathlib import Path


def whole(bag, folder):
    """Return wall and processor time of the command, s."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    started = time.perf_counter()
    subprocess.run(
        [sys.executable, "-m", "stepdiag_ros.cli", "report", str(bag), "--output", str(folder)],
        check=True,
        capture_output=True,
    )
    wall = time.perf_counter() - started
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {"wall_s": wall, "processor_s": used}


def parts(bag, folder):
    """Return the processor time of each part in one process, s."""
    found, last = {}, time.process_time()

    def lap(name):
        nonlocal last
        now = time.process_time()
        found[name] = round(now - last, 3)
        last = now

    from stepdiag_ros.bags.run import load_run
    from stepdiag_ros.evaluation.recorded_run import report_of_run
    from stepdiag_ros.report.pages.build import prepare, report_document_of, write
    from stepdiag_ros.report.pages.given import Given
    from stepdiag_ros.report.pages.material import Material
    from stepdiag_ros.report.pages.pictures import Studio

    lap("imports")
    recorded = load_run(bag)
    lap("load the run")
    report = report_of_run(recorded, lambda *_: None, with_visibility=True)
    lap("assemble from the readings, solve")
    material = Material(recorded, report, Given())

    class Later(Studio):
        """Counts the drawing apart from what the sections do."""

        def fetch_all(self):
            lap("weather, budget, diagnosis, sections")
            drawn = super().fetch_all()
            for chapter in drawn.values():
                for picture in chapter.values():
                    picture.fetch()
            lap(f"{sum(map(len, drawn.values()))} pictures, with the import of matplotlib")
            return drawn

    handover = prepare(material, Later(), lambda _: None)
    for name in ("json", "html", "pdf"):
        write(partial(report_document_of, material), handover, folder, [name], lambda _: None)
        lap(name)
    return found


def main():
    """Measure, and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("bag", type=Path)
    parser.add_argument("--runs", type=int, default=5)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        runs = [whole(arguments.bag, Path(folder)) for _ in range(arguments.runs)]
        sizes = {path.name: path.stat().st_size for path in Path(folder).iterdir()}
        figures = {
            "cores": os.cpu_count(),
            "wall_s": statistics.median(one["wall_s"] for one in runs),
            "processor_s": statistics.median(one["processor_s"] for one in runs),
            "bytes": sizes,
            "parts_processor_s": parts(arguments.bag, Path(folder)),
        }
    print(json.dumps(figures, indent=2))


if __name__ == "__main__":
    main()
