"""The simulated weather station against the cell's weather."""

from refused import refused
from test_simulated_interferometer import CELL, SECOND, START, weather

from stepdiag_ros.devices import Surroundings, prepare
from stepdiag_ros.metrology.refusal import Refusal


def test_samples_lie_on_their_grid_and_are_the_cell_s_weather():
    station = weather(rate_hz=3)
    samples = station.poll(START - 1)
    assert samples == []
    samples = station.poll(START + SECOND) + station.poll(START + 2 * SECOND)
    assert [time for time, _ in samples] == [START + round(k * SECOND / 3) for k in range(7)]
    for time, environment in samples:
        assert environment == CELL.environment((time - START) * 1e-9)


def test_sensors_have_their_errors_and_humidity_its_bounds():
    station = weather(
        air_temperature_error_K=0.5,
        air_pressure_error_Pa=-40.0,
        relative_humidity_error=0.9,
        material_temperature_error_K=-0.2,
    )
    (_, told), *_ = station.poll(START)
    true = CELL.environment(0.0)
    assert told.air_temperature == true.air_temperature + 0.5
    assert told.air_pressure == true.air_pressure - 40.0
    assert told.relative_humidity == 1.0
    assert told.material_temperature == true.material_temperature - 0.2


def test_a_silent_station_gives_nothing():
    station = weather()
    station.inject_silence(START + 2 * SECOND)
    assert len(station.poll(START + 10 * SECOND)) == 2


def test_settings_are_checked():
    with refused(Refusal, "unknown", about="rate"):
        weather(rate=2)
    with refused(Refusal, "missing"):
        prepare("weather", "simulated", {}, Surroundings())
