"""Measures the page over a fleet: how soon machines are seen in a browser, and whether it stutters.

    python benchmarks/fleet.py [--machines 5000] [--runs 12] [--page FILE.html]

A catalogue of rows that are made up (wear, noise, tolerances) becomes a page, as ``stepdiag fleet``
makes it. Chromium without a window opens the file anew in each round. First view: from the
beginning of the navigation to the second frame that has rows. Scrolling: 400 frames, 300 pixels
each; the times between frames. Filter: from a key to the next frame. The exit code is 1 if
the first view takes a second or more.
"""

import argparse
import hashlib
import json
import shutil
import statistics
import sys
import tempfile
import time
from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import Page, sync_playwright

from stepdiag_ros import __version__
from stepdiag_ros.archive import catalogue
from stepdiag_ros.archive.columns import Figure, Run
from stepdiag_ros.archive.fleet import fleet
from stepdiag_ros.archive.place import Place
from stepdiag_ros.archive.rows import Rows
from stepdiag_ros.report.pages.fleet import fleet_page

_BAR = 1000.0
"""Milliseconds to the first view."""
_SEEN = """
window.seen = new Promise((done) => {
  const next = (call) => requestAnimationFrame(call);
  const look = () => document.querySelector("#fleet tr.machine")
    ? next(() => next(() => done(performance.now()))) : next(look);
  look();
});
"""
_SCROLL = """
() => new Promise((done) => {
  const frames = [];
  let last = performance.now();
  const step = (now) => {
    frames.push(now - last);
    last = now;
    const before = scrollY;
    scrollBy({top: 300, behavior: "instant"});
    frames.length < 400 && scrollY > before ? requestAnimationFrame(step) : done(frames);
  };
  requestAnimationFrame(step);
})
"""
_FILTER = """
(text) => new Promise((done) => {
  const filter = document.getElementById("filter");
  filter.value = text;
  const began = performance.now();
  filter.dispatchEvent(new Event("input"));
  requestAnimationFrame(() => requestAnimationFrame(() => done(performance.now() - began)));
})
"""


def made_up(machines: int, runs: int) -> Rows:
    """Return rows of machines that wear, each at its own rate."""
    random, rows = np.random.default_rng(1), Rows()
    now = datetime.now(timezone.utc)
    for machine in range(machines):
        wear, level = abs(random.normal(0.0, 3e-6)), random.uniform(5e-6, 20e-6)
        days = np.sort(random.uniform(0.0, 1500.0, runs))
        for day in days:
            sha256 = hashlib.sha256(f"{machine} {day}".encode()).hexdigest()
            key = {
                "part": "part",
                "bag_sha256": sha256,
                "run_id": sha256[:12],
                "machine": f"machine {machine:04}",
                "serial_number": f"SN-{machine * 7919 % 100_000:05}",
                "start_time": now - timedelta(days=1500.0 - float(day)),
            }
            size = max(level + wear * day / 365.0 + random.normal(0.0, 4e-7), 0.0)
            unknown = dict.fromkeys(Run.__dataclass_fields__) | key
            told = {
                "run_number": 1,
                "file": "run.mcap",
                "verdict": "CONSISTENT",
                "effects": (),
                "largest_m": size,
                "largest_expanded_uncertainty_m": 8e-7,
                "software_version": __version__,
                "figure_count": 1,
                "curve_count": 0,
            }
            rows.runs.append(Run(**unknown | told))
            rows.figures.append(
                Figure(
                    **key, kind="volume", method="least_squares", name="largest in volume",
                    unit="m", value=size, standard_uncertainty=4e-7, expanded_uncertainty=8e-7,
                    low=None, high=None, relied_on=True,
                )
            )  # fmt: skip
    return rows


def made_page(machines: int, runs: int, file: Path) -> dict[str, Any]:
    """Make the page; return how long its parts took, s, and its size, MB."""
    with tempfile.TemporaryDirectory() as folder:
        place = Place(folder)
        catalogue.write_part(place, "part", made_up(machines, runs))
        Path(folder, "archive.yaml").write_text("tolerances: {largest in volume: 2.5e-5}\n")
        started = time.process_time()
        with catalogue.Catalogue(place) as opened:
            found = fleet(opened)
        read = time.process_time()
        page = fleet_page(place, found, 90, datetime.now(timezone.utc), file)
        file.write_text(page, encoding="utf-8")
        written = time.process_time()
    return {
        "reading the catalogue and its trends (s of processor)": round(read - started, 1),
        "page (s of processor)": round(written - read, 1),
        "page (MB)": round(file.stat().st_size / 1e6, 1),
    }


def measured(page: Page, file: Path) -> dict[str, float]:
    """Open the page once; return milliseconds."""
    page.add_init_script(_SEEN)
    page.goto(file.resolve().as_uri())
    first = page.evaluate("window.seen")
    frames = sorted(page.evaluate(_SCROLL))
    return {
        "first view": first,
        "frame while scrolling, median": statistics.median(frames),
        "frame while scrolling, 95 %": frames[int(0.95 * len(frames))],
        "frame while scrolling, longest": frames[-1],
        "filter": statistics.median(page.evaluate(_FILTER, text) for text in ("1", "12", "123")),
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--machines", type=int, default=5000)
    parser.add_argument("--runs", type=int, default=12)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--page", type=Path, help="keep the page here; used if it is there")
    arguments = parser.parse_args()
    program = shutil.which("chromium") or shutil.which("google-chrome")
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        file, costs = arguments.page or Path(folder) / "fleet.html", {}
        if not file.exists():
            costs = made_page(arguments.machines, arguments.runs, file)
        browser = playwright.chromium.launch(
            executable_path=program, args=["--no-sandbox", "--disable-gpu"]
        )
        rounds = []
        for _ in range(arguments.rounds):
            context = browser.new_context(viewport={"width": 1400, "height": 900})
            rounds.append(measured(context.new_page(), file))
            context.close()
        browser.close()
    found = {f"{name} (ms)": [round(one[name]) for one in rounds] for name in rounds[0]}
    first = statistics.median(one["first view"] for one in rounds)
    print(json.dumps({**costs, **found, "median of the first view (ms)": round(first)}, indent=2))
    return int(first >= _BAR)


if __name__ == "__main__":
    sys.exit(main())
