"""Air and material of a day: histories drawn at random, and their values at any time."""

import numpy as np

QUANTITIES = ("air temperature", "air pressure", "relative humidity", "material temperature")
"""What ``weather`` returns, in words and in order."""
_DAYS = 100
"""That an operator waits for weather as he is asked for it, and then measures all the same."""
_TIMES = 60


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


def another_day(before, length, conditions, rng):
    """Draw the weather of another day, one that suits what is asked of it.

    An operator who is asked for another proportion of air and material warms his machine up, if on
    no day of its room it comes by itself.

    Args:
        before: weather of the run before.
        length: of the run to come, s.
        conditions: sentences that say what weather is asked for.
        rng: of the days.
    """
    draw = plain_weather if before["plain"] else draw_weather
    day = draw(rng)
    for number in range(2 * _DAYS):
        if _suits(before, day, length, conditions):
            break
        day = draw(rng) if number < _DAYS else {**draw_weather(rng), "same": False}
    return day


def _suits(before, day, length, conditions):
    time = np.linspace(0.0, length, _TIMES)
    shares = dict(
        zip(QUANTITIES, map(_share, weather(before, time), weather(day, time)), strict=True)
    )
    for sentence in conditions:
        named = [shares[name] for name in QUANTITIES if name in sentence]
        rest = [shares[name] for name in QUANTITIES if name not in sentence]
        if "half as fast" in sentence and max(named, default=0.0) > 0.5:
            return False
        compared = named if len(named) > 1 else named + rest
        if "proportion" in sentence and not (_apart(*compared) and np.abs(compared).max() > 0.95):
            return False
    return True


def _share(before, now):
    """Return how much of the change of a quantity before there is in that of now."""
    one, other = before - before.mean(), now - now.mean()
    squares = float(one @ one)
    return float(one @ other) / squares if squares > 1e-12 else 0.0


def _apart(first, *others):
    """Tell whether one share is less than half of every other one, or more than twice it."""
    return all(
        one * first < 0.0 or not 0.5 * abs(one) < abs(first) < 2.0 * abs(one) for one in others
    )
