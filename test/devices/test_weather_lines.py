"""Weather sensors that speak in text: units, several sensors, and what happens when some fail."""

from math import isnan

import pytest
from instrument_peers import MS, SECOND, Bench, TcpPeer, is_open
from refused import a_fault, refused

from stepdiag_ros.configuration import load_device
from stepdiag_ros.devices import Surroundings, prepare
from stepdiag_ros.metrology.measurement import Environment
from stepdiag_ros.metrology.refusal import Lost, Refusal


class Peers:
    """Several peers that are attended together."""

    def __init__(self, *peers):
        self.peers = peers

    def attend(self):
        for peer in self.peers:
            peer.attend()


def prepared(settings):
    return prepare("weather", "line_protocol", settings, Surroundings())


def station(settings, *peers, step=2 * MS):
    bench = Bench(Peers(*peers), step)
    bench.open(prepared(settings))
    bench.until_true(
        lambda: all(peer.connection for peer in peers) and is_open(bench.device), 20_000
    )
    bench.for_looks(3)
    return bench


@pytest.fixture
def peers():
    peers = [TcpPeer() for _ in range(3)]
    yield peers
    for peer in peers:
        peer.close()


def sensor(peer, name, unit):
    return {
        "connection": {"url": peer.url},
        "message": {"pattern": f"^{name[:3]}=(?P<v>[-.\\d]+|err)$"},
        "values": {name: {"from": "v", "unit": unit, "unknown": "err"}},
        "silence_s": 2.0,
    }


@pytest.mark.parametrize(
    ("name", "unit", "text", "expected"),
    [
        ("air_temperature", "degC", "20.5", 20.5),
        ("air_temperature", "K", "293.15", 20.0),
        ("material_temperature", "degF", "68", 20.0),
        ("air_pressure", "Pa", "101325", 101325.0),
        ("air_pressure", "hPa", "1013.25", 101325.0),
        ("air_pressure", "kPa", "101.325", 101325.0),
        ("air_pressure", "mmHg", "760", 101325.0),
        ("air_pressure", "inHg", "29.92126", 101325.0),
        ("air_pressure", "psi", "14.69595", 101325.0),
        ("relative_humidity", "%", "45", 0.45),
        ("relative_humidity", "1", "0.45", 0.45),
    ],
)
def test_units(peers, name, unit, text, expected):
    bench = station(sensor(peers[0], name, unit), peers[0])
    peers[0].say(f"{name[:3]}={text}\n")
    ((_, told),) = bench.until(1)
    assert getattr(told, name) == pytest.approx(expected, rel=3e-6)
    assert sum(isnan(value) for value in told) == 3, "what was not told is not known"
    bench.device.close()


def test_the_lines_of_the_shipped_station_are_read(peers):
    settings, _ = load_device("vaisala_ptu300")
    settings["connection"] = {"url": peers[0].url}
    bench = station(settings, peers[0], step=10 * MS)
    answers = 0
    for _ in range(300):
        asked = peers[0].heard() or b""
        for _ in range(asked.count(b"send\r")):
            answers += 1
            peers[0].say("send\r\nP= 1013.2 hPa T= 31.1 'C RH= 38.3 %RH\r\n>")
        bench.look()
    assert 2 <= answers <= 4
    for _, told in bench.taken:
        assert told[:3] == pytest.approx((31.1, 101320.0, 0.383))
    bench.device.close()


def test_sensors_of_a_station_fail_and_come_back_one_by_one(peers):
    names = (
        ("air_temperature", "degC"),
        ("air_pressure", "hPa"),
        ("relative_humidity", "%"),
    )
    sensors = [sensor(peer, *name) for peer, name in zip(peers, names, strict=True)]
    bench = station({"sensors": sensors}, *peers, step=20 * MS)
    texts = ("air=20.5\n", "air=1000\n", "rel=50\n")

    def heard_of(seconds, who=(0, 1, 2)):
        """Return which quantities were told while some peers speak once a second."""
        before = len(bench.taken)
        for _ in range(seconds):
            for place in who:
                if peers[place].connection is not None:
                    peers[place].say(texts[place])
            bench.for_looks(SECOND // bench.step)
        told = [environment for _, environment in bench.taken[before:]]
        fields = Environment._fields
        return {name for one in told for name in fields if not isnan(getattr(one, name))}

    everything = {"air_temperature", "air_pressure", "relative_humidity"}
    assert heard_of(2) == everything
    peers[1].hang_up()
    assert heard_of(1) == everything - {"air_pressure"}
    # It is there again after five seconds, connected anew.
    assert "air_pressure" in heard_of(7)
    assert peers[1].connections == 2
    # A silent one is given up after its time, the others go on.
    assert heard_of(4, who=(0, 1)) == everything - {"relative_humidity"}
    with pytest.raises((TimeoutError, ConnectionError)):
        heard_of(8, who=())
    times = [time for time, _ in bench.taken]
    assert times == sorted(times)
    bench.device.close()


def test_a_sensor_that_does_not_know_says_so_and_garbage_is_no_sample(peers):
    bench = station(sensor(peers[0], "air_pressure", "hPa"), peers[0])
    peers[0].say("air=err\ngarbage\nair=1000\n")
    samples = bench.until(2)
    assert isnan(samples[0][1].air_pressure) and samples[1][1].air_pressure == 100_000.0
    with refused(Refusal, "malformed", "20", aspect="message"):
        peers[0].say("garbage\n" * 20)
        bench.until(1)
    bench.device.close()


def test_a_station_that_is_not_there_is_refused():
    with refused(Lost, "lost", aspect="opening"):
        url = {"connection": {"url": "socket://127.0.0.1:1"}}
        peer = type("", (), {"url": url["connection"]["url"]})
        prepared(sensor(peer, "air_pressure", "hPa"))(0).poll(0)


def test_settings_are_checked():
    class Nowhere:
        url = "socket://127.0.0.1:1"

    good = sensor(Nowhere, "air_pressure", "hPa")
    for change, words in (
        ({"values": {}}, a_fault("missing", "air_temperature", "air_pressure")),
        ({"values": {"pressure": {}}}, a_fault("unknown", about="pressure")),
        (
            {"values": {"air_pressure": {"from": "v", "unit": "at"}}},
            a_fault("unknown", "at", about="unit"),
        ),
        ({"values": {"air_pressure": {"from": "w", "unit": "Pa"}}}, a_fault("unknown")),
        ({"sensors": []}, a_fault("malformed", about="sensors")),
        ({"speed": 1}, a_fault("unknown", about="speed")),
    ):
        with refused(Refusal, words):
            prepared(good | change)
