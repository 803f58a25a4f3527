"""Random noise into the drivers of text: no crash, no step back in time, no made-up number."""

import json
from contextlib import suppress
from itertools import pairwise
from math import isnan

import numpy as np
import pytest
from instrument_peers import MS, START

from stepdiag_ros.configuration import load_device
from stepdiag_ros.devices.interferometer.ids3010 import Ids3010
from stepdiag_ros.devices.interferometer.messages import InstrumentSettings, MessageInterferometer
from stepdiag_ros.devices.link_framing import FramingSettings
from stepdiag_ros.metrology.checking import Section

LINES = {
    "umd1": lambda k: f"12345 12345 {k} 5 64 {k} 0 0\n",
    "streaming_csv": lambda k: f"{k * 2000},{k},97,00\n",
    "request_and_reply": lambda k: f"+{k:08d}.4567 mm 087 OK\r\n",
}


class NoisySource:
    """Framed bytes without any link, as much as the test gives."""

    def __init__(self, framing):
        self.framing = framing.make()
        self.data = b""

    def poll(self, _):
        data, self.data = self.data, b""
        return self.framing.take(data) if data else []

    def zero(self):
        pass

    def close(self):
        pass


def instrument(name):
    settings = load_device(name)[0]
    section = Section({key: settings[key] for key in settings if key not in LINK}, name)
    framing = FramingSettings.from_section(Section(settings.get("framing", {}), name))
    source = NoisySource(framing)
    return MessageInterferometer(InstrumentSettings.from_section(section), source, START), source


LINK = ("connection", "framing", "commands", "silence_s")


def spoil(text, random):
    """Return bytes that a bad line makes of a text: cut, doubled, or with foreign bytes in it."""
    data = bytearray(text.encode())
    kind = random.integers(0, 5)
    place = int(random.integers(0, len(data)))
    if kind == 0:
        return bytes(data[:place]) + b"\n"
    if kind == 1:
        data[place] = 0x80 | int(random.integers(0, 128))
    elif kind == 2:
        return random.bytes(int(random.integers(0, 40))) + b"\n"
    elif kind == 3:
        return bytes(data) * 2
    return bytes(data)


def value(reading):
    raw = reading.raw_displacement
    return reading.compensated_displacement if isnan(raw) else raw


@pytest.mark.parametrize("name", LINES)
def test_noise_gives_no_reading_or_a_good_one(name):
    device, source = instrument(name)
    true, found = set(), 0
    for k in range(1, 60):
        source.data = LINES[name](k).encode()
        true |= {value(reading) for reading in device.poll(START + k * 2 * MS)}
    assert len(true) == 59
    for seed in range(40):
        random = np.random.default_rng(seed)
        device, source = instrument(name)
        now, readings = START, []
        # What it says of the device is a sentence; anything else would end the node.
        with suppress(OSError, ValueError):
            for k in range(1, 60):
                now += 2 * MS
                line = LINES[name](k)
                source.data = spoil(line, random) if random.random() < 0.3 else line.encode()
                readings += device.poll(now)
        assert all(b.time > a.time and b.sequence > a.sequence for a, b in pairwise(readings))
        assert all(reading.time <= now for reading in readings)
        assert {value(reading) for reading in readings} <= true
        found += len(readings)
    assert found > 400


def test_noise_into_the_ids3010_is_a_sentence():
    class Line:
        ready, url = True, "socket://ids:9090"

        def __init__(self, random):
            self.random, self.answers = random, []

        def send(self, data):
            number = json.loads(data)["id"]
            good = {"jsonrpc": "2.0", "id": number, "result": [0, "measurement running"]}
            bad = [
                {"jsonrpc": "2.0", "id": number, "result": value}
                for value in ([], None, [None, None], ["x", {}], [[], 1e400], [0, True], [7, -1e40])
            ]
            bad += [{"id": None}, [], 5, {"id": number, "error": None}, {"id": number}]
            pick = int(self.random.integers(0, 3 * len(bad)))
            answer = bad[pick] if pick < len(bad) else good
            self.answers.append(json.dumps(answer).encode() + b"\r\n")

        def receive(self):
            data, self.answers = b"".join(self.answers), []
            return data

        def close(self):
            pass

    from stepdiag_ros.devices.interferometer import ids3010

    settings = {**load_device("ids3010")[0]}
    for seed in range(200):
        opened = []

        def link(_, seed=seed, opened=opened):
            opened.append(Line(np.random.default_rng(seed)))
            return opened[-1]

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(ids3010, "Link", link)
            device = ids3010.from_settings(settings, None)(START)
        assert isinstance(device, Ids3010)
        with suppress(OSError, ValueError):
            for k in range(200):
                device.poll(START + k * 5 * MS)
