"""Driver ``line_protocol``: an interferometer that sends text, as its settings describe it.

The link is a URL of pyserial, so the instrument may be at a serial port, at a TCP port or behind a
terminal server. The settings describe one instrument each; ``config/devices`` has examples, and
``docs/instruments.md`` explains every key.
"""

from collections.abc import Callable, Mapping
from typing import Any

from stepdiag_ros.devices import Surroundings
from stepdiag_ros.devices.interferometer.messages import InstrumentSettings, MessageInterferometer
from stepdiag_ros.devices.line_protocol_talk import Talk, TalkSettings
from stepdiag_ros.metrology.checking import Section

USUAL_RATE = 50.0
"""Hz at which an instrument that has to be asked is asked, unless its settings say otherwise."""


def from_settings(
    settings: Mapping[str, Any],
    surroundings: Surroundings,  # noqa: ARG001
) -> Callable[[int], MessageInterferometer]:
    """Return what connects the instrument at a time, ns.

    Settings: ``connection``, ``framing``, ``commands``, ``silence_s`` (see
    ``line_protocol_talk.TalkSettings``), ``message``, ``values``, ``rate_hz``, ``delay_s``,
    ``gap_s``, ``fastest_m_per_s`` (see ``messages.InstrumentSettings``).

    Raises:
        ValueError: a setting is wrong.
    """
    section = Section(settings, "settings of the interferometer")
    talk = TalkSettings.from_section(section, USUAL_RATE)
    instrument = InstrumentSettings.from_section(section)
    section.finish()
    return lambda start: MessageInterferometer(instrument, Talk(talk, start), start)
