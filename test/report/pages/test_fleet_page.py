"""The page over a fleet: what stands in it, and what it does in a browser."""

import re
import shlex
from datetime import datetime, timedelta, timezone
from pathlib import Path

import pytest
from archive_runs import digest
from chromium import chromium
from fleet_runs import run, state, written
from patience import PATIENCE

from stepdiag_ros.archive.catalogue import Catalogue
from stepdiag_ros.archive.fleet import fleet
from stepdiag_ros.archive.place import Place
from stepdiag_ros.report.pages.fleet import fleet_page

HOSTILE = "</script><script>document.title = 'taken'</script>"
MADE = datetime(2024, 6, 1, 12, tzinfo=timezone.utc)


def page_of(folder, file, every=None, made=MADE):
    """Write the page of an archive as the command does."""
    place = Place(str(folder))
    with Catalogue(place) as opened:
        machines = fleet(opened)
    text = fleet_page(place, machines, every, made, file)
    file.write_text(text, encoding="utf-8")
    return text


@pytest.fixture
def plant(tmp_path):
    """Return the folder of an archive with a machine of each state, and the file of its page."""
    folder = tmp_path / "it's a plant"
    place = Place(str(folder))
    runs = [
        run(1, "mill", 5, 9e-5, serial_number="SN-7", run_id="r1", largest_m=9e-5),
        run(2, "mill", 200, 2e-6, run_id="r 2"),
        run(3, "lathe", 100, 1e-5, verdict="NAMED"),
        run(4, HOSTILE, 5, 1e-6),
    ]
    written(place, *runs)
    state(place, "tolerances: {C0Y: 1.0e-5}\n")
    for number in (1, 2):
        bag = folder / "bags" / digest(number) / "a run.mcap"
        bag.parent.mkdir(parents=True)
        bag.touch()
    (folder / "reports" / "r1").mkdir(parents=True)
    (folder / "reports" / "r1" / "report.html").write_text("<title>report of r1</title>")
    return folder, tmp_path / "pages" / "fleet.html"


@pytest.fixture(scope="module")
def browser():
    with chromium() as made:
        yield made


@pytest.fixture
def opened(browser):
    """Return what opens a file in a new window of one visitor, and refuses errors in it."""
    visitors, errors = {}, []

    def open_page(file, visitor="one", **how):
        if visitor not in visitors:
            how = {"viewport": {"width": 1400, "height": 900}, **how}
            visitors[visitor] = browser.new_context(**how)
        page = visitors[visitor].new_page()
        page.set_default_timeout(1e3 * PATIENCE)
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.on("request", lambda one: errors.append(one.url) if "file:" not in one.url else None)
        page.goto(file.as_uri())
        return page

    yield open_page
    for one in visitors.values():
        one.close()
    assert errors == []


def names(page):
    return page.eval_on_selector_all("tr.machine button", "all => all.map(one => one.textContent)")


def test_the_page_holds_everything_and_nothing_is_taken_for_code(plant):
    folder, file = plant
    file.parent.mkdir()
    text = page_of(folder, file)
    assert not re.search(
        r"""(?:src|href)=["']|@import|url\(|https?://(?!www\.w3\.org/2000/svg)""", text
    )
    assert HOSTILE not in text and text.count("</script>") == text.count("<script") == 4
    without = text.split("<noscript>")[1].split("</noscript>")[0]
    assert without.count("<tr>") == 4 and "&lt;/script&gt;" in without
    assert text == page_of(folder, file)


def test_machines_stand_worst_first_and_open_to_their_runs(plant, opened):
    folder, file = plant
    file.parent.mkdir()
    page_of(folder, file, 90)
    page = opened(file)
    assert names(page) == ["mill", "lathe", HOSTILE] and page.title() != "taken"
    states = page.eval_on_selector_all("tr.machine", "all => all.map(one => one.className)")
    assert states == ["machine bad", "machine open", "machine good"]
    assert page.locator("tr.machine .late").count() == 3  # by the date of today
    page.click("tr.machine button")
    links = page.locator("tr.more a")
    assert links.count() == 1
    # The other run of the machine has the command that makes its report.
    command = shlex.split(page.text_content("tr.more code"))
    bag = folder / "bags" / digest(2) / "a run.mcap"
    assert command == ["stepdiag", "report", str(bag), "--html"]
    links.click()
    page.wait_for_url("**/reports/r1/report.html")
    assert page.title() == "report of r1"


def test_a_report_is_made_where_the_page_looks_for_it(plant, opened):
    folder, file = plant
    file.parent.mkdir()
    (folder / "reports" / "r1" / "report.html").unlink()
    page_of(folder, file)
    page = opened(file)
    page.click("tr.machine button")
    command = shlex.split(page.locator("tr.more code").first.text_content())
    made = Path(command[command.index("--output") + 1]) / "report.html"
    made.parent.mkdir(exist_ok=True)
    made.touch()
    page_of(folder, file)
    page.reload()
    page.click("tr.machine button")
    assert page.locator("tr.more a").count() == 1


def test_keys_move_open_filter_and_close(plant, opened):
    folder, file = plant
    file.parent.mkdir()
    page_of(folder, file)
    page = opened(file)
    focused = "document.activeElement.textContent"
    for key, name in (("ArrowDown", "mill"), ("ArrowDown", "lathe"), ("ArrowUp", "mill")):
        page.keyboard.press(key)
        assert page.evaluate(focused) == name
    page.keyboard.press("Enter")
    assert page.locator("tr.more").count() == 1
    page.keyboard.press("Escape")
    assert page.locator("tr.more").count() == 0
    page.keyboard.press("/")
    page.keyboard.type("named")
    assert names(page) == ["lathe"]
    page.keyboard.press("Enter")
    assert page.evaluate(focused) == "lathe"
    page.keyboard.press("/")
    page.keyboard.press("Escape")
    page.fill("#filter", "sn-7 mill")
    assert names(page) == ["mill"]
    page.fill("#filter", "nobody")
    assert names(page) == [] and page.is_visible("#nothing")


def test_what_is_new_since_the_last_visit_is_marked(plant, opened):
    folder, file = plant
    file.parent.mkdir()
    page_of(folder, file)
    # Nothing is new to who comes first, nor when the same page is opened again.
    for _ in range(2):
        assert opened(file).locator("tr.machine b").count() == 0
    Path(folder, "catalogue", "1", "runs", "part.parquet").unlink()
    changed = run(9, "lathe", 1, 1e-6, verdict="CONSISTENT")
    new = [run(1, "mill", 5, 9e-5, run_id="r1"), run(2, "mill", 200, 2e-6, run_id="r 2")]
    older = [run(3, "lathe", 100, 1e-5, verdict="NAMED"), run(4, HOSTILE, 5, 1e-6)]
    written(Place(str(folder)), *new, *older, changed, run(10, "new", 1, 1e-6))
    page_of(folder, file, made=MADE + timedelta(days=1))
    for _ in range(2):  # and it stays marked until another page comes
        page = opened(file)
        marks = page.eval_on_selector_all(
            "tr.machine", "all => all.map(one => one.querySelectorAll('b').length)"
        )
        assert dict(zip(names(page), marks, strict=True)) == {
            "mill": 0,
            "lathe": 2,  # a run more, and another state
            "new": 1,
            HOSTILE: 0,
        }
    assert opened(file, "another visitor").locator("tr.machine b").count() == 0
    page.click("#visit button")
    page.wait_for_function("() => !document.querySelector('tr.machine b')")


def test_many_machines_are_rows_only_where_they_are_seen_or_printed(tmp_path, opened):
    place, file = Place(str(tmp_path)), tmp_path / "fleet.html"
    written(place, *(run(number, f"m{number:04}", 5, 1e-6) for number in range(400)))
    page_of(tmp_path, file)
    page = opened(file)
    assert 10 <= len(names(page)) < 150
    page.keyboard.press("End")
    page.keyboard.press("End")
    assert page.evaluate("document.activeElement.textContent") == "m0399"
    page.wait_for_function("() => document.querySelectorAll('tr.machine').length < 150")
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    assert names(page) == sorted(f"m{number:04}" for number in range(400))


def test_a_phone_and_a_browser_without_scripts_show_all(plant, opened):
    folder, file = plant
    file.parent.mkdir()
    page_of(folder, file)
    phone = opened(file, viewport={"width": 360, "height": 700})
    for button in phone.locator("tr.machine button").all():
        button.click()
    assert phone.evaluate("document.documentElement.scrollWidth") == 360
    assert phone.locator("tr.more").count() == 3
    plain = opened(file, "without", java_script_enabled=False)
    text = plain.inner_text("body")
    assert all(name in text for name in ("mill", "lathe", HOSTILE, "NAMED", "SN-7"))
    assert plain.is_hidden("#fleet") and plain.is_hidden("#tools")
