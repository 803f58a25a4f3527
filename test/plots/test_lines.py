"""Blocks, readings with their windows, repeatability: what is drawn is what was measured."""

import numpy as np
import pytest
from refused import refused
from results_by_hand import VOLUME, make_measurement

from stepdiag_ros import plots
from stepdiag_ros.metrology.air.recompensation import SensorValue
from stepdiag_ros.metrology.measurement import (
    BlockDisplacement,
    Environment,
    Reading,
    SettledStop,
    StopCommand,
)
from stepdiag_ros.metrology.plan import Line
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.plots.lines import passes_from_mean

LINE = Line("linear", "x", "", 0, "forward")
SECOND = 10**9


def stop(number, settled=True):
    begin = (10 + number) * SECOND
    return SettledStop(
        command=StopCommand(number, 0, 1, "x", number, "X", (0.0, 0.0, 0.0), begin),
        line=LINE,
        position=(0.0, 0.0, 0.0),
        settled=settled,
        reason="" if settled else "moved",
        time=begin,
        displacement=number * 0.01 if settled else np.nan,
        raw_displacement=number * 0.01,
        standard_uncertainty=1e-8,
        standard_deviation=1e-8,
        readings=5,
        first_sequence=0,
        last_sequence=4,
        in_position_time=begin,
        window_start=begin,
        window_end=begin + SECOND // 2,
        environment=Environment(),
    )


def readings(count=60, step=SECOND // 10, compensated=True):
    for number in range(count):
        value = number * 1e-3
        yield Reading(
            9 * SECOND + number * step,
            number,
            value,
            value * 1.0003 if compensated else np.nan,
            1.0,
            0,
            Environment(),
        )


def lines_of(axes):
    return {line.get_label(): line for line in axes.get_lines()}


def test_readings_are_drawn_around_the_windows_of_the_stops():
    figure = plots.readings(readings(), [stop(0), stop(1), stop(2, settled=False)])
    (axes,) = figure.axes
    drawn = lines_of(axes)["reading"]
    taken = [one for one in readings() if 10 <= one.time / SECOND <= 12.5]
    assert len(drawn.get_xdata()) == len(taken)
    np.testing.assert_allclose(
        drawn.get_ydata(), [one.compensated_displacement * 1e3 for one in taken]
    )
    np.testing.assert_allclose(lines_of(axes)["value of the stop"].get_ydata(), [0.0, 10.0])
    labels = [patch.get_label() for patch in axes.patches]
    assert labels.count("window of a settled stop") == 2 and labels.count("rejected stop") == 1
    to_data = axes.transData.inverted()
    starts = [to_data.transform(patch.get_window_extent().p0)[0] for patch in axes.patches]
    np.testing.assert_allclose(starts, [0.0, 1.0, 2.0], atol=1e-9)
    assert "1 of 3 stops were rejected." in [text.get_text() for text in figure.texts]
    assert axes.get_ylabel() == "displacement / mm"


def test_without_air_the_raw_readings_are_drawn_and_named():
    (axes,) = plots.readings(readings(compensated=False), [stop(0)]).axes
    assert axes.get_ylabel() == "displacement in vacuum wavelengths / mm"


def test_many_readings_keep_their_extremes():
    fast = list(readings(count=9000, step=SECOND // 1000))
    spike = fast[4000]._replace(compensated_displacement=99.0)
    fast[4000] = spike
    (axes,) = plots.readings(fast, [stop(number) for number in range(8)]).axes
    band = axes.collections[0].get_paths()[0].vertices
    assert band[:, 1].max() == pytest.approx(99e3)


def test_nothing_to_draw_is_said():
    with refused(Refusal, "too_few", aspect="stop"):
        plots.readings(readings(), [])
    with refused(Refusal, "missing"):
        plots.readings([], [stop(0)])
    with refused(Refusal, "too_few", aspect="block"):
        plots.block_displacements([])


def test_blocks_are_drawn_beside_their_nominal_displacement():
    line = Line("step_diagonal", "ppp", "XYZ", 0, "forward")
    blocks = [
        BlockDisplacement(0, 1, line, 0, number, "XYZ"[number % 3], 0, 1, 0.01, 0.01 + error, 1e-8)
        for number, error in enumerate((1e-6, -2e-6, 3e-6, 4e-6))
    ]
    (axes,) = plots.block_displacements(blocks).axes
    assert axes.get_title() == "ppp" and axes.get_ylabel() == "excess / µm"
    np.testing.assert_allclose(lines_of(axes)["moves of X"].get_ydata(), [1.0, 4.0])
    np.testing.assert_allclose(lines_of(axes)["moves of X"].get_xdata(), [0, 3])
    np.testing.assert_allclose(lines_of(axes)["moves of Z"].get_ydata(), [3.0])


def test_a_block_run_backwards_is_longer_by_the_same_excess():
    line = Line("linear", "x", "", 0, "backward")
    back = BlockDisplacement(0, 1, line, 0, 1, "X", 1, 0, -0.01, -0.01 - 2e-6, 1e-8)
    (axes,) = plots.block_displacements([back]).axes
    np.testing.assert_allclose(axes.get_lines()[0].get_ydata(), [2.0])


def test_repeatability_turns_backward_passes_round():
    measurement = make_measurement()
    figure = plots.repeatability(measurement)
    assert [axes.get_title() for axes in figure.axes] == ["x", "ppp XYZ"]
    for axes in figure.axes:
        passes = [curve for one in axes.collections for curve in one.get_segments()]
        assert len(passes) == 2
        for curve in passes:
            np.testing.assert_allclose(curve[:, 1], 0.0, atol=1e-9)
    lines = [line for line in measurement.lines if line.setup == "x"]
    lines[0].displacement[1] += 2e-6
    moved = passes_from_mean(lines)
    np.testing.assert_allclose(moved[:, 1], [1e-6, -1e-6], atol=1e-15)
    assert plots.repeatability(type(measurement)(VOLUME, ())) is None


def test_weather_has_a_panel_for_what_was_told_and_says_what_was_not():
    values = [SensorValue(n * 60 * SECOND, "air_pressure", 101_325.0 + n) for n in range(3)]
    values.append(SensorValue(0, "relative_humidity", 0.45))
    figure = plots.weather(values)
    assert [axes.get_title() for axes in figure.axes] == ["Air pressure", "Relative humidity"]
    (line,) = figure.axes[0].get_lines()
    np.testing.assert_allclose(line.get_xdata(), [0.0, 1.0, 2.0])
    np.testing.assert_allclose(line.get_ydata(), [1013.25, 1013.26, 1013.27])
    assert figure.axes[1].get_lines()[0].get_ydata()[0] == pytest.approx(45.0)
    said = " ".join(text.get_text() for text in figure.texts)
    assert "Measured by no sensor: air temperature, material temperature." in said
    assert plots.weather([]) is None


def test_stops_are_enlarged_about_their_own_values_with_their_windows():
    stops = [stop(number) for number in (1, 2)]
    figure = plots.settling(readings(count=400, step=SECOND // 100), stops, title="")
    whole, *enlarged = figure.axes
    assert len(enlarged) == 2
    assert len(whole.patches) == 2
    for panel, one in zip(enlarged, stops, strict=True):
        (window,) = panel.patches
        begin = (one.window_start - stops[0].window_start) / SECOND
        assert window.get_x() == pytest.approx(begin)
        assert window.get_width() == pytest.approx(0.5)
        low, high = panel.get_xlim()
        assert low < begin and begin + 0.5 < high
        time, value = panel.lines[0].get_data()
        # These readings go on by 1 mm each: what is drawn is the reading less the stop's value.
        number = (time + 11.0 - 9.0) * 100.0
        expected = (number * 1e-3 * 1.0003 - one.displacement) * 1e6
        np.testing.assert_allclose(value, expected, rtol=1e-9)
        assert panel.get_title() == f"stop {one.command.stop}"


def test_a_rejected_stop_is_enlarged_about_the_mean_of_its_window():
    figure = plots.settling(readings(count=400, step=SECOND // 100), [stop(1, settled=False)])
    panel = figure.axes[1]
    time, value = panel.lines[0].get_data()
    inside = (time >= 0.0) & (time <= 0.5)
    assert abs(value[inside].mean()) < 1e-6
    assert panel.patches[0].get_hatch() == "///"


def test_stops_without_readings_are_refused():
    with refused(Refusal, "too_few", aspect="stop"):
        plots.settling(readings(), [])
    with refused(Refusal, "missing"):
        plots.settling([], [stop(1)])
