"""Instruments that speak in text: what their messages mean, and everything that goes wrong."""

from itertools import pairwise
from math import isnan

import pytest
from instrument_peers import MS, START, Bench, TcpPeer
from refused import a_fault, refused

from stepdiag_ros.configuration import available, load_device
from stepdiag_ros.devices import Surroundings, known_drivers, prepare
from stepdiag_ros.devices.interferometer import (
    STATUS_BEAM_LOST,
    STATUS_COUNT_ERROR,
    STATUS_FAULT,
    STATUS_LOW_SIGNAL,
    STATUS_OK,
    STATUS_OVERSPEED,
)
from stepdiag_ros.devices.interferometer.messages import MOST_UNREADABLE
from stepdiag_ros.devices.line_protocol import StartedAgain
from stepdiag_ros.metrology.refusal import Lost, Refusal, Silent

ALIGNMENT = ("x", (0.01, 0.0, 0.0), (0.0, 0.0, 0.0))
STREAM = {
    "message": {"columns": ["length", "signal", "state"], "skip": "^#", "restarted": "^BOOT"},
    "values": {
        "raw": {"from": "length", "unit": "um"},
        "signal": {"full": 100, "low_below": 20, "lost_below": 5},
        "status": {
            "from": "state",
            "words": {
                "OK": "good",
                "LOW": "low_signal",
                "E1": "beam_lost",
                "E2": "overspeed",
                "E3": "count_error",
            },
        },
    },
}


class Instrument:
    """A streaming instrument with its driver, connected."""

    def __init__(self, settings, step=2 * MS):
        self.peer = TcpPeer()
        self.bench = Bench(self.peer, step)
        connection = {"connection": {"url": self.peer.url}}
        self.opener = prepare("interferometer", "line_protocol", connection | settings, NOBODY)
        self.open()

    def open(self):
        self.bench.open(self.opener)
        self.bench.connect()
        self.bench.for_looks(3)

    def say(self, text, count=None):
        """Return the readings that lines bring."""
        self.peer.say(text)
        return self.bench.until(text.count("\n") if count is None else count, looks=500)

    def close(self):
        self.bench.device.close()
        self.peer.close()


NOBODY = Surroundings()


@pytest.fixture
def instrument():
    made = []

    def make(settings=STREAM, **more):
        made.append(Instrument({**settings, **more}))
        return made[-1]

    yield make
    for one in made:
        one.close()


def test_a_line_is_a_reading(instrument):
    laser = instrument()
    readings = laser.say("12.5,80,OK\r\n-3,50,OK\r\n# comment\r\n1e3,100,OK\r\n", 3)
    assert [reading.raw_displacement for reading in readings] == pytest.approx(
        [12.5e-6, -3e-6, 1e-3]
    )
    assert [reading.signal_strength for reading in readings] == [0.8, 0.5, 1.0]
    assert all(isnan(reading.compensated_displacement) for reading in readings)
    assert [reading.sequence for reading in readings] == [0, 1, 2]
    assert all(START < a.time < b.time <= laser.bench.now for a, b in pairwise(readings))


@pytest.mark.parametrize(
    ("line", "status"),
    [
        ("1,80,OK", STATUS_OK),
        ("1,80,LOW", STATUS_LOW_SIGNAL),
        ("1,19.9,OK", STATUS_LOW_SIGNAL),
        ("1,4,OK", STATUS_BEAM_LOST),
        ("1,80,E1", STATUS_BEAM_LOST),
        ("---,80,E1", STATUS_BEAM_LOST),
        ("1,80,E2", STATUS_OVERSPEED),
        ("1,80,E3", STATUS_COUNT_ERROR),
        ("1,4,E2", STATUS_BEAM_LOST),
        ("1,80,E77", STATUS_FAULT),
    ],
)
def test_words_and_signal_give_the_status(instrument, line, status):
    (reading,) = instrument().say(line + "\n")
    assert reading.status == status
    assert isnan(reading.raw_displacement) == (status == STATUS_BEAM_LOST)


@pytest.mark.parametrize(
    ("values", "text", "expected"),
    [
        ({"raw": {"from": "a", "unit": "nm"}}, "250", 250e-9),
        ({"raw": {"from": "a", "unit": "pm"}}, "250", 250e-12),
        ({"raw": {"from": "a", "unit": "mm"}, "sign": -1}, "+1.5", -1.5e-3),
        ({"raw": {"from": "a", "unit": "in"}}, "1", 0.0254),
        ({"raw": {"from": "a", "unit": "m", "factor": 0.5}}, "- 1 000.5e-3", -0.50025),
        (
            {"raw": {"from": "a", "unit": "count", "counts_per_wavelength": 8}},
            "-16",
            -2 * 632.9908e-9,
        ),
        (
            {
                "raw": {
                    "from": "a",
                    "unit": "count",
                    "counts_per_wavelength": 1024,
                    "wavelength_m": 1e-6,
                    "format": "hex",
                    "bits": 32,
                }
            },
            "FFFFFC00",
            -1e-6,
        ),
        (
            {
                "raw": {
                    "from": "a",
                    "unit": "count",
                    "counts_per_wavelength": 4,
                    "wavelength_m": 1e-6,
                    "fine": "b",
                    "fine_parts": 256,
                }
            },
            "10,-64",
            9.75 * 0.25e-6,
        ),
    ],
)
def test_numbers_and_units(instrument, values, text, expected):
    message = {"pattern": "^(?P<a>[^,]+),?(?P<b>.*)$"}
    (reading,) = instrument(message=message, values=values).say(text + "\n")
    assert reading.raw_displacement == pytest.approx(expected, rel=1e-12)


def test_raw_and_compensated_values_flags_trigger_and_a_decimal_comma(instrument):
    laser = instrument(
        message={"separator": ";", "columns": ["n", "r", "c", "f", "k"], "decimal_comma": True},
        values={
            "raw": {"from": "r", "unit": "mm"},
            "compensated": {"from": "c", "unit": "mm"},
            "status": {"from": "f", "format": "hex", "bits": {0: "beam_lost", 4: "overspeed"}},
            "sequence": {"from": "n", "wraps_at": 100},
            "trigger": {"from": "k"},
        },
    )
    first, second = laser.say("98;1,5;1,25;00;7\n1;2,5;2,25;12;8\n")
    assert (first.raw_displacement, first.compensated_displacement) == (1.5e-3, 1.25e-3)
    assert (first.status, second.status) == (STATUS_OK, STATUS_OVERSPEED)
    assert (first.trigger, second.trigger) == (7, 8)
    # 99 and 0 are missing, over the place where the number begins again.
    assert (first.sequence, second.sequence) == (0, 3)


def test_readings_that_waited_are_spread_over_their_time(instrument):
    laser = instrument(delay_s=0.005)
    laser.bench.step = 100 * MS
    readings = laser.say("".join(f"{k},80,OK\n" for k in range(10)))
    times = [reading.time for reading in readings]
    assert times[-1] == laser.bench.now - 5 * MS
    assert [b - a for a, b in pairwise(times)] == [10 * MS] * 9


def test_the_clock_of_the_instrument_tells_the_times_and_may_begin_again(instrument):
    laser = instrument(
        message={"columns": ["t", "x"]},
        values={
            "raw": {"from": "x", "unit": "mm"},
            "time": {"from": "t", "unit": "us", "wraps_at": 1 << 32},
        },
        delay_s=0.001,
    )
    ticks = [(1 << 32) - 30_000 + 10_000 * k for k in range(9)]
    times = []
    for k, tick in enumerate(ticks):
        # The link is late by as much as it likes, now and then by nothing.
        laser.bench.step = (10 + 7 * (k % 3 == 1) - 7 * (k % 3 == 2)) * MS // 5
        laser.bench.for_looks(4)
        times += [one.time for one in laser.say(f"{tick % (1 << 32)},1\n")]
    assert all(abs(b - a - 10 * MS) <= 2 * MS for a, b in pairwise(times[2:]))
    assert times[-1] < laser.bench.now
    with refused(StartedAgain, "restarted", aspect="clock"):
        laser.say("1000,1\n")


def test_gaps_are_found_by_number_or_by_time(instrument):
    numbered = instrument(
        message={"columns": ["n", "x"]},
        values={"raw": {"from": "x", "unit": "mm"}, "sequence": {"from": "n"}},
    )
    readings = numbered.say("5,1\n6,1\nga#bage\n8,1\n8,1\n9,1\n", 4)
    assert [reading.sequence for reading in readings] == [0, 1, 3, 4]
    with refused(StartedAgain, "restarted", "9", "0", aspect="number"):
        numbered.say("0,1\n")

    timed = instrument(
        message={"columns": ["t", "x"]},
        values={"raw": {"from": "x", "unit": "mm"}, "time": {"from": "t", "unit": "ms"}},
        rate_hz=100,
        gap_s=0.015,
    )
    readings = timed.say("100,1\n110,1\n140,1\n150,1\n")
    assert [reading.sequence for reading in readings] == [0, 1, 4, 5]


def test_what_cannot_be_read_is_a_lost_reading(instrument):
    laser = instrument()
    # The first line was cut in the middle, and is nobody's loss.
    readings = laser.say("5,80,OK\n"[4:] + "1,80,OK\n2,x,OK\n\xff\n3,80,OK\n", 2)
    assert [reading.raw_displacement for reading in readings] == pytest.approx([1e-6, 3e-6])
    assert [reading.sequence for reading in readings] == [0, 3]
    for number in ("nan", "inf", "1_0", "0x10", "1e9", ""):
        assert laser.say(f"{number},80,OK\n4,80,OK\n", 1)[0].raw_displacement == pytest.approx(4e-6)


def test_a_device_that_speaks_another_language_is_refused(instrument):
    laser = instrument()
    with refused(Refusal, "malformed", "hello", "1"):
        laser.say("hello\n" * (MOST_UNREADABLE + 1), 1)


def test_half_lines_and_a_stream_of_garbage(instrument):
    laser = instrument(framing={"longest": 100})
    for part in ("12.", "5,8", "0,OK\n1"):
        laser.peer.say(part)
        laser.bench.for_looks(5)
    assert [reading.raw_displacement for reading in laser.bench.taken] == pytest.approx([12.5e-6])
    with refused(Refusal, "too_many"):
        laser.say(bytes(range(128, 255)).decode("latin-1") * 10, 1)


def test_a_jump_that_no_mirror_makes_is_a_lost_count(instrument):
    laser = instrument(fastest_m_per_s=0.5, rate_hz=500)
    assert laser.say("0,80,OK\n")[0].status == STATUS_OK
    laser.bench.device.align(laser.bench.now, "x", *ALIGNMENT)
    assert laser.say("1000,80,OK\n")[0].status == STATUS_OK, "the count was zeroed"
    assert laser.say("1500,80,OK\n")[0].status == STATUS_OK
    assert laser.say("200000,80,OK\n")[0].status == STATUS_OVERSPEED
    assert laser.say("200001,80,OK\n")[0].status == STATUS_OVERSPEED, "it stays lost"


def test_the_zero_is_set_at_the_alignment_and_a_lost_count_stays_lost(instrument):
    laser = instrument()
    laser.say("100,80,OK\n")
    # Before any alignment the operator sees the beam come and go.
    assert [one.status for one in laser.say("0,80,E1\n5,80,OK\n")] == [STATUS_BEAM_LOST, STATUS_OK]
    laser.bench.device.align(laser.bench.now, "x", *ALIGNMENT)
    readings = laser.say("7,80,OK\n9,80,OK\n")
    assert [one.raw_displacement for one in readings] == pytest.approx([0.0, 2e-6], abs=1e-15)
    lost = laser.say("9,80,E1\n1,80,OK\n")
    assert [one.status for one in lost] == [STATUS_BEAM_LOST] * 2
    assert isnan(lost[0].raw_displacement) and not isnan(lost[1].raw_displacement)
    laser.bench.device.align(laser.bench.now, "x", *ALIGNMENT)
    back = laser.say("50,80,OK\n51,80,OK\n")
    assert [one.status for one in back] == [STATUS_OK] * 2
    assert [one.raw_displacement for one in back] == pytest.approx([0.0, 1e-6], abs=1e-15)


def test_an_instrument_that_starts_again_falls_silent_or_hangs_up_is_given_up(instrument):
    laser = instrument(silence_s=0.5)
    laser.say("1,80,OK\n")
    with refused(StartedAgain, "restarted", "BOOT v1", aspect="greeting"):
        laser.say("2,80,OK\nBOOT v1\n", 2)
    laser.bench.device.close()
    laser.peer.hang_up()
    laser.open()
    assert laser.say("1,80,OK\n")[0].sequence == 0
    assert laser.bench.for_looks(240) == []
    with refused(Silent, "silent", "0.5"):
        laser.bench.for_looks(20)
    laser.bench.device.close()
    laser.peer.hang_up()
    laser.open()
    # Power lost in the middle of a line.
    laser.peer.say("1,80,OK\n2,8")
    laser.peer.hang_up()
    with refused(Lost, "lost", aspect="link"):
        laser.bench.for_looks(500)
    assert laser.bench.taken[-1].raw_displacement == pytest.approx(1e-6)


ASKED = {
    "commands": {
        "line_end": "\r",
        "start": "REMOTE",
        "stop": "LOCAL",
        "zero": "RESET",
        "request": ["POS?", "SIG?"],
        "rate_hz": 50,
    },
    "framing": {"terminator": "\r"},
    "message": {"pattern": r"^(?P<x>[-+.\d]+) mm$", "skip": "^(OK|S)"},
    "values": {"compensated": {"from": "x", "unit": "mm"}},
    "silence_s": 0.4,
}


class TestRequests:
    def serve(self, laser, looks, replies):
        heard = b""
        for _ in range(looks):
            laser.bench.look()
            new = laser.peer.heard() or b""
            heard += new
            for request, reply in replies.items():
                laser.peer.say(reply * new.count(request))
        return heard

    def test_requests_go_in_turn_each_after_the_answer(self, instrument):
        laser = instrument(ASKED)
        heard = self.serve(laser, 100, {b"POS?": b"+1.5 mm\r", b"SIG?": b"S 80\r"})
        assert heard.startswith(b"REMOTE\rPOS?\rSIG?\rPOS?\r")
        # 200 ms at 50 Hz.
        assert 8 <= heard.count(b"POS?") <= 11
        assert abs(heard.count(b"POS?") - heard.count(b"SIG?")) <= 1
        assert laser.bench.taken[-1].compensated_displacement == 1.5e-3
        laser.bench.device.align(laser.bench.now, "x", *ALIGNMENT)
        assert b"RESET\r" in self.serve(laser, 20, {b"POS?": b"+9 mm\r", b"SIG?": b"S 80\r"})
        assert laser.bench.taken[-1].compensated_displacement == 0.0
        laser.bench.device.close()
        assert (laser.peer.heard() or b"").endswith(b"LOCAL\r")

    def test_a_request_without_an_answer_is_not_repeated_but_an_error(self, instrument):
        laser = instrument(ASKED)
        heard = self.serve(laser, 190, {})
        assert heard == b"REMOTE\rPOS?\r"
        with refused(Silent, "silent", "POS?", "0.4"):
            self.serve(laser, 50, {})

    def test_what_the_device_repeats_is_no_answer(self, instrument):
        commands = {**ASKED["commands"], "echo": True, "request": "POS?"}
        laser = instrument({**ASKED, "commands": commands})
        heard = self.serve(laser, 50, {b"POS?": b"POS?\r"})
        assert heard.count(b"POS?") == 1


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"message": {"columns": ["a", "a"]}}, a_fault("twice", "columns", "a")),
        ({"message": {"columns": ["_", "_"]}}, a_fault("too_few", "columns")),
        ({"message": {"pattern": "(?P<a>"}}, a_fault("malformed", "pattern")),
        ({"message": {"pattern": "a+"}}, a_fault("missing", "pattern")),
        ({"message": {}}, a_fault("missing", about="columns")),
        ({"values": {"signal": {}}}, a_fault("missing", "raw", "compensated")),
        ({"values": {}}, a_fault("missing", "raw", "compensated")),
        ({"values": {"raw": {"unit": "mm"}}}, a_fault("unknown", "from", "raw")),
        ({"values": {"raw": {"from": "length"}}}, a_fault("missing", about="unit")),
        (
            {"values": {"raw": {"from": "length", "unit": "feet"}}},
            a_fault("unknown", "feet", about="unit"),
        ),
        (
            {"values": {"raw": {"from": "length", "unit": "count"}}},
            a_fault("missing", about="counts_per_wavelength"),
        ),
        (
            {"values": {"raw": {"from": "length", "unit": "m"}, "sign": 0}},
            a_fault("out_of_range", "sign", "0", "1", "-1"),
        ),
        (
            {
                "values": {
                    "raw": {"from": "length", "unit": "m"},
                    "status": {"from": "state", "words": {"A": "fine"}},
                }
            },
            a_fault("unknown", "fine", about="words: A"),
        ),
        (
            {
                "values": {
                    "raw": {"from": "length", "unit": "m"},
                    "status": {"from": "state", "words": {True: "good"}},
                }
            },
            a_fault("malformed", about="words"),
        ),
        ({"connection": {"url": "10.1.1.1:3"}}, a_fault("malformed", "socket://10.1.1.1:3")),
        ({"rate": 3}, a_fault("unknown", about="rate")),
        ({"commands": {"request": 5}}, a_fault("malformed", "5", about="request")),
    ],
)
def test_settings_are_checked_before_anything_is_opened(change, words):
    settings = {"connection": {"url": "socket://127.0.0.1:9"}, **STREAM, **change}
    with refused(Refusal, words):
        prepare("interferometer", "line_protocol", settings, NOBODY)


def test_every_file_that_is_shipped_can_be_used_by_the_driver_that_it_names():
    used = []
    for name in available("devices"):
        settings, text = load_device(name)
        driver, kind = text.split("Driver: ")[1].split(")")[0].split(" (")
        if driver in ("line_protocol", "file_tail", "ids3010"):
            assert driver in known_drivers(kind)
            prepare(kind, driver, settings, NOBODY)
            used.append(name)
    assert {"umd1", "ids3010", "csv_file", "vaisala_ptu300", "two_sensors"} <= set(used)


SAMPLES = {
    "umd1": ("12345 12345 1000 5 64 77 0 0\n", "raw_displacement", 1000.25 * 632.991e-9 / 4),
    "request_and_reply": ("+0000123.4567 mm 087 OK\r\n", "compensated_displacement", 0.1234567),
    "streaming_csv": ("1234567,-88213,97,00\n", "raw_displacement", -88213 * 632.991e-9 / 8),
}


@pytest.mark.parametrize("name", SAMPLES)
def test_the_lines_in_the_shipped_files_are_read(instrument, name):
    line, field, expected = SAMPLES[name]
    settings, _ = load_device(name)
    del settings["connection"]
    laser = instrument(settings)
    (reading,) = laser.say(line)
    assert getattr(reading, field) == pytest.approx(expected, rel=1e-12)
    assert reading.status == STATUS_OK


def test_a_missing_frequency_of_the_umd1_is_a_lost_beam(instrument):
    settings, _ = load_device("umd1")
    del settings["connection"]
    (reading,) = instrument(settings).say("12345 0 1000 0 2048 78 0 0\n")
    assert reading.status == STATUS_BEAM_LOST
