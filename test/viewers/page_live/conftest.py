"""A simulated cell with the monitor node, an operator who hears all of it, and a browser."""

import re
import sys
from pathlib import Path

import pytest
from chromium import chromium
from patience import PATIENCE
from running_cell import RunningCell, fixture_of

from stepdiag_ros import topics

KEPT = (
    topics.STOP,
    topics.BLOCK,
    topics.VOLUMETRIC_ERRORS,
    topics.RUN_VERDICT,
    topics.DIAGNOSIS,
    topics.RUN_DESCRIPTION,
    topics.RUN_STATE,
    *(topic for topic, _ in topics.WEATHER.values()),
)


@pytest.fixture(scope="module", autouse=True)
def browser():
    """Return a browser without a window."""
    with chromium() as made:
        yield made


class Pages:
    """Pages of one browser, and what went wrong in them."""

    def __init__(self, browser):
        self._browser = browser
        self.errors = []

    def open(self, url, width=1400, scheme="light"):
        context = self._browser.new_context(
            viewport={"width": width, "height": 900}, color_scheme=scheme
        )
        page = context.new_page()
        page.set_default_timeout(1e3 * PATIENCE)
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.on("console", lambda said: said.type == "error" and self.errors.append(said.text))
        page.goto(url)
        page.wait_for_selector("#contact[data-contact=good]")
        return page


@pytest.fixture(scope="module")
def pages(browser):
    return Pages(browser)


class CellOnAPage(RunningCell):
    """The cell with the monitor; what was said and what is on the page."""

    def __init__(self, folder):
        super().__init__(folder, KEPT, [("monitor", {"port": 0})])

    @property
    def url(self):
        """The address with the token, as it was printed."""
        return self.logged_once("monitor", r"open (http://127\.0\.0\.1:\d+/#token=\w+)")

    def last(self, topic, **fields):
        found = [
            one for one in self.said[topic] if all(getattr(one, k) == v for k, v in fields.items())
        ]
        return found[-1]


cell = fixture_of(CellOnAPage)


@pytest.fixture(scope="module")
def replay(cell):
    """Start ``stepdiag monitor`` on the bag of the run; return its address and its process."""
    import subprocess

    path = Path(cell.folder) / "replay.out"
    with path.open("w") as out:
        process = subprocess.Popen(
            [
                *(sys.executable, "-m", "stepdiag_ros.cli", "monitor", str(cell.bag())),
                *("--rate", "0", "--port", "0"),
            ],
            stderr=out,
        )
    cell.wait(lambda: "all of the recording is shown" in path.read_text(), "the bag is played")
    yield re.search(r"http://\S+/", path.read_text()).group(0), process
    if process.poll() is None:
        process.kill()
    process.wait()
