"""The IDS3010 driver against a server that speaks its documented JSON-RPC."""

from itertools import pairwise
from math import isnan

import pytest
from instrument_peers import MS, SECOND, START, Bench, Ids3010Peer
from refused import a_fault, refused

from stepdiag_ros.devices import Surroundings, prepare
from stepdiag_ros.devices.interferometer import (
    STATUS_BEAM_LOST,
    STATUS_FAULT,
    STATUS_LOW_SIGNAL,
    STATUS_OK,
    STATUS_OVERSPEED,
)
from stepdiag_ros.metrology.refusal import Lost, Refusal, Silent

ALIGNMENT = ("x", (0.01, 0.0, 0.0), (0.0, 0.0, 0.0))


def opener(peer, **settings):
    given = {"host": "127.0.0.1", "port": peer.port, "rate_hz": 100.0} | settings
    return prepare("interferometer", "ids3010", given, Surroundings())


@pytest.fixture
def ids():
    peer = Ids3010Peer()
    yield peer
    peer.close()


@pytest.fixture
def bench(ids):
    bench = Bench(ids)
    bench.open(opener(ids))
    yield bench
    bench.device.close()


def test_it_reads_displacement_signal_and_index(bench, ids):
    ids.displacement_pm = 123_456_789.0
    readings = bench.until(20)
    last = readings[-1]
    assert last.compensated_displacement == pytest.approx(123.456789e-6, abs=1e-15)
    assert last.raw_displacement == pytest.approx(123.456789e-6 * 1.00027, abs=1e-15)
    assert (last.signal_strength, last.status) == (0.8, STATUS_OK)
    assert [reading.sequence for reading in readings] == list(range(20))
    steps = [b.time - a.time for a, b in pairwise(readings)]
    assert 8 * MS <= sum(steps) / len(steps) <= 14 * MS and min(steps) > 0
    assert all(START < reading.time <= bench.now for reading in readings)


def test_both_families_of_names_are_found():
    peer = Ids3010Peer("com.attocube.sen")
    bench = Bench(peer)
    bench.open(opener(peer))
    assert bench.until(3)
    assert peer.asked[0][0] == "com.attocube.ids.system.getCurrentMode"
    bench.device.close()
    peer.close()


def test_the_measurement_is_begun_and_waited_for(ids):
    ids.mode = "system idle"
    bench = Bench(ids)
    bench.open(opener(ids, start_within_s=20.0))
    bench.until_true(lambda: ids.mode == "measurement starting")
    assert bench.for_looks(600) == []
    ids.mode = "measurement running"
    assert bench.until(2)
    started = [method for method, _ in ids.asked if method.endswith("startMeasurement")]
    assert len(started) == 1
    bench.device.close()

    ids.mode = "measurement starting"
    bench = Bench(ids, step=20 * MS)
    bench.open(opener(ids, start_within_s=20.0))
    with refused(Silent, "silent", "20", aspect="measurement"):
        bench.for_looks(1500)


@pytest.mark.parametrize("mode", ["system idle", "optics alignment running"])
def test_an_instrument_that_does_not_measure_is_refused(ids, mode):
    ids.mode = mode
    bench = Bench(ids)
    bench.open(opener(ids, start_measurement=False))
    with refused(Lost, "not_ready") as caught:
        bench.for_looks(1000)
    assert mode in str(caught.value)


def test_a_measurement_that_ends_is_noticed(bench, ids):
    bench.until(3)
    ids.mode = "system idle"
    with refused(Lost, "stopped"):
        bench.for_looks(2000)


def test_a_zero_is_set_by_software_and_moves_with_the_alignment(bench, ids):
    ids.displacement_pm = 5e9
    bench.until(3)
    bench.device.align(bench.now, "x", *ALIGNMENT)
    assert bench.until(1)[0].compensated_displacement == 0.0
    ids.displacement_pm += 1e9
    assert bench.until(3)[-1].compensated_displacement == pytest.approx(1e-3, abs=1e-12)
    bench.device.align(bench.now, "x", *ALIGNMENT)
    assert bench.until(1)[0].compensated_displacement == pytest.approx(1e-3, abs=1e-12)
    assert not any(method.endswith("resetAxis") for method, _ in ids.asked)


@pytest.mark.parametrize(
    ("number", "status"),
    [(4001, STATUS_BEAM_LOST), (4002, STATUS_OVERSPEED), (4003, STATUS_LOW_SIGNAL)],
)
def test_warnings_are_understood_by_their_words(bench, ids, number, status):
    bench.until(3)
    bench.device.align(bench.now, "x", *ALIGNMENT)
    bench.until(2)
    ids.warning = number
    # Readings of before the warning may still be on their way.
    readings = bench.until(6)
    assert readings[-1].status == status
    assert {reading.status for reading in readings} <= {STATUS_OK, status}
    assert isnan(readings[-1].raw_displacement) == (status == STATUS_BEAM_LOST)
    asked = [call for call in ids.asked if call[0].endswith("errorNumberToString")]
    assert asked == [("com.attocube.system.errorNumberToString", [0, number])]
    ids.warning = 0
    # A lost count stays lost, a weak signal does not.
    expected = STATUS_OK if status == STATUS_LOW_SIGNAL else status
    assert bench.until(6)[-1].status == expected
    bench.device.align(bench.now, "x #2", *ALIGNMENT)
    assert bench.until(6)[-1].status == STATUS_OK
    resets = [call for call in ids.asked if call[0].endswith("resetError")]
    assert len(resets) == (status != STATUS_LOW_SIGNAL)


def test_a_warning_that_nobody_understands_is_a_fault_unless_the_settings_know_it(ids):
    ids.words[4711] = "Flux capacitor is cold"
    ids.warning = 4711
    for settings, status in (({}, STATUS_FAULT), ({"warnings": {4711: "good"}}, STATUS_OK)):
        bench = Bench(ids)
        bench.open(opener(ids, **settings))
        assert bench.until(3)[-1].status == status
        bench.device.close()


def test_weak_contrast_is_a_low_signal_and_a_jump_is_a_lost_count(bench, ids):
    bench.until(3)
    ids.contrast = 30
    assert bench.until(60)[-1].status == STATUS_LOW_SIGNAL
    ids.contrast = 800
    assert bench.until(60)[-1].status == STATUS_OK
    ids.displacement_pm = 0.5e12
    assert STATUS_OVERSPEED in [reading.status for reading in bench.until(4)]


def test_an_instrument_without_compensation_tells_raw_values_alone(ids):
    bench = Bench(ids)
    bench.open(opener(ids, refractive_index=1.0))
    ids.displacement_pm = 2e9
    last = bench.until(5)[-1]
    assert last.raw_displacement == pytest.approx(2e-3) and isnan(last.compensated_displacement)
    bench.device.close()

    ids.index = [42, 0.0]
    bench = Bench(ids)
    bench.open(opener(ids))
    with refused(Refusal, "undetermined", "refractive_index", "42)"):
        bench.for_looks(1000)


@pytest.mark.parametrize(
    ("garbage", "words"),
    [
        (b"hello\r\n", a_fault("malformed", aspect="JSON")),
        (b"[1, 2]\r\n", a_fault("malformed", aspect="JSON-RPC")),
        (b'{"jsonrpc": "2.0", "result": [0', a_fault("silent", aspect="answer")),
        (b"x" * 70000, a_fault("too_many")),
        (b"\xff\xfe\x00\r\n", a_fault("malformed", aspect="JSON")),
    ],
)
def test_garbage_is_refused_in_words(ids, garbage, words):
    bench = Bench(ids, step=10 * MS)
    bench.open(opener(ids))
    bench.until(3)
    ids.garbage = garbage
    with refused((ValueError, TimeoutError), words):
        bench.for_looks(1000)


def test_silence_and_a_lost_connection_are_errors_and_a_new_device_begins_anew(ids):
    bench = Bench(ids, step=10 * MS)
    bench.open(opener(ids))
    bench.until(5)
    ids.silent = True
    with refused(Silent, "silent", "com.attocube", "2", aspect="answer"):
        bench.for_looks(1000)
    bench.device.close()
    ids.silent = False
    ids.hang_up()
    bench.open(opener(ids))
    assert bench.until(3)[0].sequence == 0
    ids.hang_up()
    with refused(Lost, "lost", aspect="link"):
        bench.for_looks(1000)
    bench.device.close()
    ids.close()
    with refused(Lost, "lost", aspect="opening"):
        bench.open(opener(ids))
        bench.for_looks(50)


def test_halves_of_answers_are_kept(bench, ids):
    bench.until(3)
    whole = ids.say
    halves = []

    def say(text):
        halves.append(text)
        whole(text[: len(text) // 2])
        bench.device.poll(bench.now)
        whole(text[len(text) // 2 :])

    ids.say = say
    assert len(bench.until(10)) >= 10 and len(halves) >= 10


def test_settings_are_checked_before_anything_is_opened(ids):
    for settings, words in (
        ({"axis": 3}, a_fault("out_of_range", "3", "0", "2", about="axis")),
        ({"host": "a b"}, a_fault("malformed", "host", "a b", "IP")),
        ({"warnings": {12: "bad"}}, a_fault("unknown", "low_signal", about="warnings: 12")),
        ({"sing": 1}, a_fault("unknown", "sign", about="sing")),
    ):
        with refused(Refusal, words):
            opener(ids, **settings)
    for given in ({}, {"hots": "192.168.1.1"}):
        with refused(Refusal, "missing", "IP", *given, about="host"):
            prepare("interferometer", "ids3010", given, Surroundings())
    assert ids.connections == 0
    assert SECOND == 1000 * MS
