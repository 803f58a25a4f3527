"""Air and material of a day: histories drawn at random, and their values at any time."""

import numpy as np


def draw_weather(rng):
    """Draw histories of air and material: drift, warm-up and slow wave, not the same for both."""
    return {
        "start": float(rng.uniform(-1.0, 1.0)),
        "drift": float(rng.uniform(-0.4, 0.4)) / 3600.0,
        "wave": float(rng.uniform(0.1, 0.6)),
        "period": float(rng.uniform(1200.0, 7000.0)),
        "warm": float(rng.uniform(0.3, 1.5)),
        "warm_time": float(rng.uniform(1500.0, 6000.0)),
        "lag": float(rng.uniform(600.0, 2500.0)),
        "pressure": float(rng.uniform(-40.0, 40.0)) / 3600.0,
        "humidity": float(rng.uniform(0.3, 0.6)),
        "same": bool(rng.random() < 0.25),
        "plain": False,
    }


def plain_weather(rng):
    """One temperature for air and material that swings about 20 degC; the rest stands still."""
    told = draw_weather(rng)
    return {**told, "start": 0.0, "same": True, "plain": True}


def weather(told, time):
    """Air temperature, pressure, humidity and material temperature at times."""

    def air(at):
        wave = told["wave"] * np.sin(2.0 * np.pi * at / told["period"])
        return 20.0 + told["start"] + told["drift"] * at + wave

    if told["plain"]:
        return air(time), np.full(len(time), 101325.0), np.full(len(time), 0.5), air(time)
    pressure = 101325.0 + told["pressure"] * time
    humidity = told["humidity"] + 0.02 * np.sin(2.0 * np.pi * time / (2.3 * told["period"]))
    if told["same"]:
        return air(time), pressure, humidity, air(time)
    # The material follows the air late and weakly, and warms up with the machine.
    warmed = told["warm"] * (1.0 - np.exp(-time / told["warm_time"]))
    material = 20.0 + 0.4 * (air(time - told["lag"]) - 20.0) + warmed
    return air(time), pressure, humidity, material
