"""Driver ``line_protocol``: weather sensors that send text, as their file of settings describes it.

One sensor may report all quantities, or several sensors some of them each, at links of their own.
A quantity that a message lacks is NaN in its sample: nothing is carried over from an older one. A
sensor that fails is opened again and again while others go on; only when all have failed does the
driver give up, and its node opens it again.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from stepdiag_ros.devices import Surroundings
from stepdiag_ros.devices.line_protocol import MessageSettings, NoMessage, SentQuantity, quantity
from stepdiag_ros.devices.line_protocol_talk import Talk, TalkSettings
from stepdiag_ros.metrology.checking import Section
from stepdiag_ros.metrology.measurement import Environment
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.units import NANOSECONDS

USUAL_RATE = 1.0
"""Hz at which a sensor that has to be asked is asked, unless its settings say otherwise."""
MOST_UNREADABLE = 20
"""Messages in a row that may be unreadable before the sensor counts as another one."""
RETRY_AFTER = 5 * NANOSECONDS
"""ns after which a sensor that has failed is opened again."""

_ZERO_CELSIUS = 273.15
_TEMPERATURES: Mapping[str, Callable[[float], float]] = {
    "degC": lambda value: value,
    "K": lambda value: value - _ZERO_CELSIUS,
    "degF": lambda value: (value - 32.0) / 1.8,
}
_PRESSURES: Mapping[str, Callable[[float], float]] = {
    "Pa": lambda value: value,
    "hPa": lambda value: value * 100.0,
    "mbar": lambda value: value * 100.0,
    "kPa": lambda value: value * 1000.0,
    "bar": lambda value: value * 1e5,
    # Conventional millimetre and inch of mercury, and psi: NIST SP 811, appendix B.8.
    "mmHg": lambda value: value * 133.3224,
    "inHg": lambda value: value * 3386.389,
    "psi": lambda value: value * 6894.757,
}
_HUMIDITIES: Mapping[str, Callable[[float], float]] = {
    "1": lambda value: value,
    "%": lambda value: value / 100.0,
}
UNITS: Mapping[str, Mapping[str, Callable[[float], float]]] = {
    "air_temperature": _TEMPERATURES,
    "air_pressure": _PRESSURES,
    "relative_humidity": _HUMIDITIES,
    "material_temperature": _TEMPERATURES,
}
"""Field of Environment → unit → conversion to that of the field."""


@dataclass(frozen=True)
class SensorSettings:
    """One sensor.

    Attributes:
        talk: how to talk with it.
        message: how its messages are split into fields.
        quantities: field of Environment → where it stands in a message.
        delay: from the measurement to the arrival of the message, ns.
    """

    talk: TalkSettings
    message: MessageSettings
    quantities: Mapping[str, SentQuantity]
    delay: int

    @classmethod
    def from_section(cls, section: Section) -> "SensorSettings":
        """Take the settings of a sensor, and finish them.

        Raises:
            ValueError: a setting is wrong, or the message contains nothing.
        """
        talk = TalkSettings.from_section(section, USUAL_RATE)
        message = MessageSettings.from_section(section.section("message"))
        values = section.section("values")
        found = {name: quantity(values, name, message, units) for name, units in UNITS.items()}
        values.finish()
        quantities = {name: one for name, one in found.items() if one is not None}
        if not quantities:
            raise Refusal(
                f"{values.source}: no quantity is given; expected {', '.join(UNITS)}",
                fault="missing",
            )
        delay = round(NANOSECONDS * section.number("delay_s", low=0.0, high=3600.0, default=0.0))
        section.finish()
        return cls(talk, message, quantities, delay)


class Sensor:
    """One sensor that is connected.

    Args:
        settings: how it is read.
        time_ns: now.

    Raises:
        OSError: it is not there.
    """

    def __init__(self, settings: SensorSettings, time_ns: int) -> None:
        self._settings = settings
        self._talk = Talk(settings.talk, time_ns)
        self._unreadable = 0
        self._last = -1

    def poll(self, time_ns: int) -> list[tuple[int, Environment]]:
        """Return the samples since the last poll; see ``WeatherDevice.poll``."""
        samples = []
        for message in self._talk.poll(time_ns):
            try:
                fields = self._settings.message.split(message)
                if fields is None:
                    continue
                told = {name: one.number(fields) for name, one in self._settings.quantities.items()}
            except NoMessage as error:
                self._unreadable += 1
                if self._unreadable >= MOST_UNREADABLE:
                    raise Refusal(
                        f"{MOST_UNREADABLE} messages of {self._talk.url} in a row cannot be read,"
                        f" the last one since {error}",
                        fault="malformed",
                        aspect="message",
                    ) from None
                continue
            self._unreadable = 0
            self._last = max(time_ns - self._settings.delay, self._last + 1)
            samples.append((self._last, Environment(**told)))
        return samples

    def close(self) -> None:
        """Let it go."""
        self._talk.close()


class MessageWeather:
    """One or more sensors as one station (``WeatherDevice``).

    Args:
        settings: of the sensors, at least one.
        time_ns: now.

    Raises:
        OSError: none of them is there.
    """

    def __init__(self, settings: tuple[SensorSettings, ...], time_ns: int) -> None:
        self._settings = settings
        self._sensors: list[Sensor | None] = [None] * len(settings)
        self._retry_at = [time_ns] * len(settings)
        self._failures: list[Exception | None] = [None] * len(settings)
        self._open_what_is_due(time_ns)

    def poll(self, time_ns: int) -> list[tuple[int, Environment]]:
        """Return the samples since the last poll with their times (ns), in order.

        Raises:
            OSError: no sensor is left.
            ValueError: what the only one left says makes no sense.
        """
        self._open_what_is_due(time_ns)
        samples: list[tuple[int, Environment]] = []
        for place, sensor in enumerate(self._sensors):
            if sensor is None:
                continue
            try:
                samples += sensor.poll(time_ns)
            except (OSError, ValueError) as error:
                self._give_up(place, error, time_ns)
        self._check()
        return sorted(samples, key=lambda sample: sample[0])

    def close(self) -> None:
        """Let all sensors go."""
        for sensor in self._sensors:
            if sensor is not None:
                sensor.close()

    def _open_what_is_due(self, time_ns: int) -> None:
        for place, sensor in enumerate(self._sensors):
            if sensor is None and time_ns >= self._retry_at[place]:
                try:
                    self._sensors[place] = Sensor(self._settings[place], time_ns)
                except (OSError, ValueError) as error:
                    self._give_up(place, error, time_ns)
        self._check()

    def _give_up(self, place: int, error: Exception, time_ns: int) -> None:
        sensor, self._sensors[place] = self._sensors[place], None
        self._failures[place] = error
        self._retry_at[place] = time_ns + RETRY_AFTER
        if sensor is not None:
            sensor.close()

    def _check(self) -> None:
        if any(sensor is not None for sensor in self._sensors):
            return
        for failure in self._failures:
            if failure is not None:
                raise failure


def from_settings(
    settings: Mapping[str, Any],
    surroundings: Surroundings,  # noqa: ARG001
) -> Callable[[int], MessageWeather]:
    """Return what connects the sensors at a time, ns.

    Settings of one sensor: ``connection``, ``framing``, ``commands``, ``silence_s`` (see
    ``line_protocol_talk.TalkSettings``), ``message``, ``values`` (``air_temperature``,
    ``air_pressure``, ``relative_humidity``, ``material_temperature``), ``delay_s``. Of several: the
    same for each in the list ``sensors``.

    Raises:
        ValueError: a setting is wrong.
    """
    section = Section(settings, "settings of the weather station")
    if "sensors" in section.keys():  # noqa: SIM118
        parts = section.sections("sensors")
        section.finish()
    else:
        parts = [section]
    sensors = tuple(SensorSettings.from_section(part) for part in parts)
    return lambda start: MessageWeather(sensors, start)
