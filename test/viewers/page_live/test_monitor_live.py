"""A run on live nodes, led from the page, with what is on the page against what was published.

One run after the other: the tests follow each other in the order in which they stand here.
"""

import json
import signal

import numpy as np
import pytest
from patience import PATIENCE

from stepdiag_ros import topics
from stepdiag_ros.messages.volumetric import to_volumetric_errors
from stepdiag_ros.metrology.geometry import SQUARENESS
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR
from stepdiag_ros.run.sequence import State
from stepdiag_ros.text.numbers import plus_minus
from stepdiag_ros.viewers.page.measured import micrometres
from stepdiag_ros.viewers.page.section import measured

RESULTS = ("headline", "curves", "squareness", "verdict", "volume")


def text(page, selector):
    return page.inner_text(selector)


def confirm(page):
    page.click("#confirm button[value=yes]")


@pytest.fixture(scope="module")
def page(cell, pages):
    return pages.open(cell.url)


def test_nothing_moves_before_somebody_confirms(cell, page):
    cell.wait(lambda: text(page, "#run-state") == "nothing is measured", "the state of the run")
    assert "token" not in page.url, "the token is in the address line"
    page.keyboard.press("s")
    page.wait_for_selector("#confirm[open]")
    page.keyboard.press("Escape")
    # The button with the focus is No.
    page.keyboard.press("s")
    page.wait_for_selector("#confirm[open]")
    page.keyboard.press("Enter")
    page.wait_for_selector("#confirm:not([open])", state="attached")
    cell.operator.spin_until(lambda: False, 1.0)
    assert cell.state() is State.IDLE
    assert "asks to" not in cell.log("monitor")


def test_a_run_is_led_from_the_page(cell, page):
    page.keyboard.press("s")
    confirm(page)
    cell.wait(lambda: "begins" in text(page, "#answer"), "the answer to the start")
    paused = False

    def go_on():
        nonlocal paused
        state = cell.state()
        if state is State.RUNNING and not paused and cell.said[topics.STOP]:
            if not page.is_disabled("[data-action=pause]"):
                page.click("[data-action=pause]")
                paused = True
        elif state in (State.PAUSED, State.WAITING_FOR_SETUP) and not page.is_disabled(
            "[data-action=resume]"
        ):
            page.click("[data-action=resume]")
            confirm(page)
            cell.operator.spin_until(lambda: cell.state() is State.RUNNING, PATIENCE)
        return state is State.FINISHED

    cell.wait(go_on, "the run is finished")
    assert paused and State.PAUSED in [State(one.state) for one in cell.said[topics.RUN_STATE]]
    log = cell.log("monitor")
    assert "127.0.0.1 asks to start the run" in log and "127.0.0.1 asks to pause the run" in log


def all_is_heard(cell):
    """Say whether everything that belongs to the finished run has come to the test too."""
    state = cell.last(topics.RUN_STATE)
    results = [one for one in cell.said[topics.VOLUMETRIC_ERRORS] if one.method == "least_squares"]
    return (
        any(one.run_over for one in cell.said[topics.DIAGNOSIS])
        and any(one.run_over for one in cell.said[topics.RUN_VERDICT])
        and len(cell.said[topics.STOP]) == state.stops_total
        and bool(results)
        and results[-1].lines == state.line_count
        and cell.said[topics.BLOCK][-1].line_index == state.line_count - 1
        and cell.said[topics.BLOCK][-1].to_stop == cell.said[topics.STOP][-1].stop
    )


def test_what_is_on_the_page_is_what_was_published(cell, page):
    cell.wait(lambda: all_is_heard(cell), "all of the run is heard")

    def shows(selector, wanted, exactly=True):
        cell.wait(
            lambda: text(page, selector) == wanted if exactly else wanted in text(page, selector),
            f"{selector} shows {wanted}",
        )

    state = cell.last(topics.RUN_STATE)
    shows("#run-state", "finished")
    shows("#run-stops", f"{state.stops_done} of {state.stops_total} stops")
    shows("#run-id", state.run_id)

    result = to_volumetric_errors(cell.last(topics.VOLUMETRIC_ERRORS, method="least_squares"))
    shows("#curves-method", f"Least squares, from {result.lines} passes; band: U (95 %)")
    shown = page.evaluate(
        "[...document.querySelectorAll('.curve')].map(one =>"
        " [one.dataset.name, one.querySelector('.chart').dataset.values])"
    )
    assert len(shown) == 9
    for name, values in shown:
        np.testing.assert_allclose(json.loads(values), result.curves[name] * 1e6, rtol=1e-5)
    assert page.locator(".curve canvas").count() == 9
    for name in SQUARENESS:
        figure = result.figure(name)
        wanted = f"{plus_minus(figure.value, figure.standard_uncertainty, 1e6)} µm/m"
        shows(f"#squareness-list [data-name={name}]", wanted)

    worst = cell.last(topics.RUN_VERDICT, run_over=True)
    spread = worst.expanded_uncertainty / COVERAGE_FACTOR
    shows("#worst-what", "Largest error so far")
    shows("#worst-text", f"{plus_minus(worst.worst_error, spread, 1e6)} µm")
    shows(
        "#worst-where",
        f"(U so far, 95 %) at X {worst.worst_place[0] * 1e3:.1f}, Y ",
        exactly=False,
    )

    diagnosis = cell.last(topics.DIAGNOSIS, run_over=True)
    lines = f"{diagnosis.lines} of {diagnosis.lines_planned} passes"
    shows("#verdict-lines", lines)
    shows("#verdict-word", diagnosis.verdict)
    shows("#headline-verdict", diagnosis.verdict)
    shows("#verdict-sentence", diagnosis.sentence)
    shows("#verdict-gap [data-name=rms]", micrometres(diagnosis.rms_before))

    block = cell.last(topics.BLOCK)
    shows("#blocks-last", measured(block.displacement, "mm", 5, 1e3), exactly=False)
    stop = cell.last(topics.STOP)
    shows("#stop-where", f"stop {stop.stop}, {stop.readings} readings", exactly=False)
    first = next(one for one in cell.said[topics.STOP] if one.setup == stop.setup)
    moved = stop.displacement - first.displacement
    shows("#stop-displacement", measured(moved, "mm", 5, 1e3))
    looks = page.eval_on_selector_all("#course-list li", "all => all.map(one => one.dataset.look)")
    assert looks and set(looks) == {"measured"}


@pytest.mark.parametrize(
    ("label", "topic", "written"),
    [
        ("air", topics.AIR_TEMPERATURE, lambda said: f"{said.temperature:.2f} °C"),
        ("machine", topics.MATERIAL_TEMPERATURE, lambda said: f"{said.temperature:.2f} °C"),
        ("pressure", topics.AIR_PRESSURE, lambda said: f"{said.fluid_pressure / 100:.2f} hPa"),
        ("humidity", topics.RELATIVE_HUMIDITY, lambda said: f"{said.relative_humidity:.1%}"),
    ],
)
def test_the_air_is_as_the_sensors_say(cell, page, label, topic, written):
    shown = f"#weather-list [data-name={label}]"
    before, seen = len(cell.said[topic]), set()

    def is_new():
        # On a busy computer the page may be ahead of this test, or behind.
        seen.add(text(page, shown))
        said = {written(one).replace("%", " %") for one in cell.said[topic][before:]}
        return not seen.isdisjoint(said)

    cell.wait(is_new, f"{label} is one that was published since")


def test_who_comes_late_sees_the_same_and_leads_nothing_without_the_token(cell, page, pages):
    late = pages.open(cell.url.partition("#")[0], width=390, scheme="dark")
    cell.wait(
        lambda: all(text(late, f"#{one}") == text(page, f"#{one}") for one in RESULTS),
        "the late viewer sees the same",
    )
    assert late.is_hidden("#controls") and late.is_visible("#no-controls")
    assert page.is_visible("#controls")
    # No sideways scrolling on a phone.
    assert late.evaluate("document.documentElement.scrollWidth") <= 390
    refused = late.evaluate(
        "fetch('control/start', {method: 'POST'}).then(answer => answer.status)"
    )
    assert refused == 403 and cell.state() is State.FINISHED
    pages.errors = [one for one in pages.errors if "403" not in one]
    late.context.close()


def test_the_headline_says_how_much_of_the_run_a_verdict_rests_on(cell, pages):
    other = pages.open(cell.url.partition("#")[0], width=390)
    gap = {"rms": "0.1 µm", "largest": "0.2 µm"}
    told = {"verdict": "CONSISTENT", "sentence": "", "lines": 8, "lines_planned": 24, "gap": gap}
    told |= {"gap_left": None, "where": [], "findings": []}
    script = "told => import('./sections.js').then(page => page.SECTIONS.verdict(told))"
    for final in (False, True):
        other.evaluate(script, told | {"final": final})
        shown, look = text(other, "#headline-verdict"), other.locator("#headline-verdict.good")
        assert ("8 of 24" not in shown, look.count() == 1) == (final, final)
    curve = {"name": "E_XX", "axis": "X", "known": "none", "values": [None], "positions": [0.0]}
    script = "told => import('./charts.js').then(page => page.drawCurves([told]))"
    other.evaluate(script, curve | {"uncertainty": [None]})
    assert other.is_hidden(".curve .chart") and other.is_visible(".curve h3")
    other.context.close()


def test_on_a_wide_screen_the_curves_are_above_the_fold_and_every_card_is_filled(cell, pages):
    wide = pages.open(cell.url.partition("#")[0], width=1400)
    cell.wait(lambda: wide.locator(".curve canvas").count() == 9, "the curves are drawn")
    bottom = "document.getElementById('curves').getBoundingClientRect().bottom"
    cell.wait(lambda: wide.evaluate(bottom) <= 900, "the curves end above the fold")
    empty = wide.evaluate(
        "Object.fromEntries([...document.querySelectorAll('main section')].map(card => {"
        " const whole = card.getBoundingClientRect();"
        " const ends = [...card.children].map(one => one.getBoundingClientRect().bottom);"
        " const inner = whole.bottom - parseFloat(getComputedStyle(card).paddingBottom);"
        " return [card.id, (inner - Math.max(...ends)) / whole.height]; }))"
    )
    assert len(empty) == 10
    assert max(empty.values()) < 0.15, empty
    wide.context.close()


def test_a_bag_is_played_as_the_run_was_seen(cell, page, pages, replay):
    url, process = replay
    played = pages.open(url)
    for one in RESULTS:
        cell.wait(
            lambda: text(played, f"#{one}") == text(page, f"#{one}"),  # noqa: B023 - waited for here
            f"{one} of the bag is what was seen",
        )
    # The recorded end of the run is the last that is shown.
    cell.wait(lambda: text(played, "#run-state") == "finished", "the end of the run")
    assert played.is_visible("#replay") and played.is_hidden("#controls")
    assert played.is_hidden("#no-controls")
    played.context.close()
    process.send_signal(signal.SIGINT)
    assert process.wait(PATIENCE) == 0


def test_abort_asks_nothing_and_is_shown(cell, page):
    first_run, whole = text(page, "#run-id"), text(page, "#curves-method")
    page.keyboard.press("s")
    confirm(page)
    cell.wait(lambda: text(page, "#run-state") == "measuring", "a second run")
    page.keyboard.press("a")
    cell.wait(lambda: cell.state() is State.ABORTED, "the run is aborted")
    cell.wait(lambda: text(page, "#run-state") == "aborted", "the page says so")
    assert text(page, "#run-text") == cell.last(topics.RUN_STATE).text
    # A new run begins with an empty page: what there is now is of the few lines of this one.
    assert text(page, "#run-id") == cell.last(topics.RUN_STATE).run_id != first_run
    assert text(page, "#curves-method") != whole


def test_a_lost_node_and_a_lost_server_are_said(cell, page, pages):
    process = cell.processes.running["weather"]
    process.kill()
    process.wait()
    cell.wait(
        lambda: any(
            "weather node /weather is silent" in one
            for one in page.locator("#fault-list li.fault").all_inner_texts()
        ),
        "the page says that the node is silent",
    )
    # Who would have to start a run is gone too.
    assert text(page, "#refused-start") == "" and not page.is_disabled("[data-action=start]")
    process = cell.processes.running["sequencer"]
    process.kill()
    process.wait()
    cell.wait(
        lambda: (
            text(page, "#refused-start") == "Nothing can be started: no message from a sequencer."
        ),
        "the page says that nobody starts a run",
    )
    assert page.is_disabled("[data-action=start]")
    assert pages.errors == []
    monitor = cell.processes.running["monitor"]
    monitor.terminate()
    assert monitor.wait(PATIENCE) == 0
    page.wait_for_selector("#contact[data-contact=lost]")
    assert text(page, "#contact").startswith("no contact since ")
