"""A file that another program writes: growth, halves, truncation, rotation, an end."""

import pytest
from instrument_peers import MS, SECOND, START, Bench
from refused import refused

from stepdiag_ros.devices import Surroundings, prepare
from stepdiag_ros.devices.interferometer import STATUS_BEAM_LOST, STATUS_OK
from stepdiag_ros.metrology.refusal import Silent, Unusable

SETTINGS = {
    "message": {"columns": ["length", "state"]},
    "values": {
        "compensated": {"from": "length", "unit": "mm"},
        "status": {"from": "state", "words": {0: "good", 2: "beam_lost"}},
    },
}


class Tail:
    """A file with the driver that follows it."""

    def __init__(self, path, **more):
        self.path = path
        self.bench = Bench(None, step=20 * MS)
        settings = {"path": str(path), **SETTINGS, **more}
        self.opener = prepare("interferometer", "file_tail", settings, Surroundings())

    def open(self):
        self.bench.open(self.opener)

    def write(self, text, mode="a"):
        with self.path.open(mode) as file:
            file.write(text)

    def lengths(self, looks=10):
        return [round(one.compensated_displacement * 1e3, 9) for one in self.bench.for_looks(looks)]


@pytest.fixture
def tail(tmp_path):
    tail = Tail(tmp_path / "laser.csv")
    tail.write("1,0\n2,0\n3,")
    tail.open()
    yield tail
    tail.bench.device.close()


def test_only_what_is_added_is_read_and_halves_wait(tail):
    assert tail.lengths() == []
    # The rest of a line that was begun before is no line.
    tail.write("0\n4,0\n5,")
    assert tail.lengths() == [4.0]
    tail.write("0\n6,2\n7,0\n")
    readings = tail.bench.for_looks(5)
    assert [one.status for one in readings] == [STATUS_OK, STATUS_BEAM_LOST, STATUS_OK]
    assert [one.sequence for one in readings] == [1, 2, 3]


def test_a_file_may_be_read_from_its_start(tmp_path):
    tail = Tail(tmp_path / "laser.csv", from_start=True)
    tail.write("1,0\n2,0\n")
    tail.open()
    assert tail.lengths() == [1.0, 2.0]
    tail.bench.device.close()


def test_a_file_that_is_cut_off_is_read_from_its_new_start(tail):
    tail.write("8,0\n9,0\n10,0\n")
    tail.lengths()
    tail.write("20,0\n", mode="w")
    assert tail.lengths() == [20.0]


def test_another_file_of_the_name_is_followed_and_nothing_of_the_old_one_is_lost(tail):
    tail.write("0\n4,0\n")
    tail.lengths()
    tail.write("5,0\n")
    tail.path.rename(tail.path.with_suffix(".1"))
    assert tail.lengths() == [5.0]
    tail.write("100,0\n101,0\n", mode="w")
    assert tail.lengths() == [100.0, 101.0]


def test_what_is_added_to_the_old_file_while_it_is_replaced_is_not_lost(tail):
    tail.write("0\n4,0\n")
    tail.lengths()
    # Between the look into the file and the look for another one.
    tail.write("5,0\n")
    tail.path.rename(tail.path.with_suffix(".1"))
    tail.write("100,0\n", mode="w")
    assert tail.bench.device._source._follow() == [b"5,0", b"100,0"]


def test_a_file_that_stands_still_or_is_not_there_is_an_error(tail, tmp_path):
    tail.write("0\n")
    tail.bench.step = SECOND
    with refused(Silent, "silent", "laser.csv", "10"):
        tail.lengths(20)
    with refused(Unusable, "unreadable", "gone.csv"):
        Tail(tmp_path / "gone.csv").open()
    patient = Tail(tail.path, silence_s=0)
    patient.open()
    patient.bench.step = 3600 * SECOND
    assert patient.lengths() == []


def test_times_in_the_file_are_the_times_of_the_readings(tmp_path):
    more = {
        "message": {"columns": ["t", "length", "state"], "separator": ";", "decimal_comma": True},
        "values": {**SETTINGS["values"], "time": {"from": "t", "unit": "iso8601"}},
        "from_start": True,
        "delay_s": 0.25,
        "rate_hz": 2,
        "gap_s": 0.75,
    }
    tail = Tail(tmp_path / "laser.csv", **more)
    tail.write("2023-11-14T22:13:20.000;1,5;0\n2023-11-14T22:13:20.500;1,5;0\n")
    tail.write("2023-11-14T23:13:22.000+01:00;1,5;0\nyesterday;1,5;0\n")
    tail.write("2023-11-14T22:13:22.500Z;1,5;0\n")
    tail.open()
    readings = tail.bench.for_looks(3)
    assert [one.time - START for one in readings] == [
        -250 * MS,
        250 * MS,
        1750 * MS,
        2250 * MS,
    ]
    assert [one.sequence for one in readings] == [0, 1, 4, 6]
    tail.bench.device.close()

    more["values"] = {**SETTINGS["values"], "time": {"from": "t", "unit": "s", "clock": "computer"}}
    more["message"] = {"columns": ["t", "length", "state"]}
    tail = Tail(tmp_path / "other.csv", **more)
    tail.write("1700000000.25,1,0\n")
    tail.open()
    # A number of seconds since 1970 has no more digits than this.
    assert abs(tail.bench.for_looks(2)[0].time - START) < 1000
    tail.bench.device.close()
