"""The nodes with instruments that speak in text: compensation, bad weather, faults, an operator."""

import socket
from math import isnan

import pytest
import rclpy
import yaml
from refused import a_fault, refused
from test_managed_nodes import RUN, Bench

from stepdiag_ros import topics
from stepdiag_ros.configuration import load_plan
from stepdiag_ros.messages.fields import set_header
from stepdiag_ros.metrology.air import index_of
from stepdiag_ros.metrology.measurement import Environment
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.nodes.interferometer import InterferometerNode
from stepdiag_ros.nodes.links import message_class
from stepdiag_ros.nodes.weather import WeatherNode
from stepdiag_ros.run.sequence import State

AIR = Environment(21.0, 100_500.0, 0.4, 20.5)
LASER = {
    "message": {"columns": ["length", "state"]},
    "values": {
        "raw": {"from": "length", "unit": "mm"},
        "status": {"from": "state", "words": {"OK": "good", "E1": "beam_lost"}},
    },
    "silence_s": 60.0,
}
STATION = {
    "message": {"columns": ["t", "p", "h"]},
    "values": {
        "air_temperature": {"from": "t", "unit": "degC"},
        "air_pressure": {"from": "p", "unit": "hPa", "unknown": "err"},
        "relative_humidity": {"from": "h", "unit": "%"},
    },
    "silence_s": 60.0,
}


class Instrument(Bench):
    """A node, its manager, and the instrument at the other end of a TCP connection."""

    def __init__(self, kind, settings, folder, *parameters):
        self.server = socket.create_server(("127.0.0.1", 0))
        self.server.setblocking(False)
        self.connection = None
        url = f"socket://127.0.0.1:{self.server.getsockname()[1]}"
        file = folder / "device.yaml"
        file.write_text(yaml.safe_dump({"connection": {"url": url}} | settings))
        super().__init__(kind, "device:=line_protocol", f"device_file:={file}", *parameters)
        self.weather = {name: self.speaker(topic) for name, (topic, _) in topics.WEATHER.items()}

    def connect(self):
        self.until(self.is_connected)

    def is_connected(self):
        if self.connection is None:
            try:
                self.connection, _ = self.server.accept()
            except BlockingIOError:
                return False
        device = self.node.device
        if device is None:
            return False
        source = device._sensors[0]._talk if hasattr(device, "_sensors") else device._source
        # What is said before the link is open is lost, as on a serial port.
        return source._link.ready

    def hang_up(self):
        self.connection.close()
        self.connection = None

    def say(self, text):
        self.connection.sendall(text.encode())

    def read(self, text):
        """Return the reading that a line of the instrument brings."""
        heard = self.heard[topics.READING]
        heard.clear()
        self.say(text + "\n")
        self.until(lambda: heard)
        return heard[-1]

    def tell_weather(self, environment, until):
        """Publish what sensors of a station elsewhere say, until something holds."""

        def told():
            for name, (topic, field) in topics.WEATHER.items():
                message = message_class(topic)(**{field: getattr(environment, name)})
                set_header(message, self.node.now())
                self.weather[name].publish(message)
            return until()

        self.until(told)

    def diagnostic(self, task):
        """Return the last words on a task, and its level."""
        for array in reversed(self.heard[topics.DIAGNOSTICS]):
            for status in array.status:
                if status.name.endswith(f": {task}"):
                    return status.message, ord(status.level)
        return "", -1

    def run_state(self, state, setup="x", line_index=0):
        message = message_class(topics.RUN_STATE)(
            run_id=RUN, state=int(state), setup=setup, line_index=line_index
        )
        self.states.publish(message)


def environment_of(reading):
    """Return the air by which a reading is compensated: quantities come one by one."""
    return Environment(*(getattr(reading, name) for name in Environment._fields))


@pytest.fixture
def instrument(tmp_path):
    made = []

    def make(*arguments):
        made.append(Instrument(*arguments[:2], tmp_path, *arguments[2:]))
        return made[-1]

    yield make
    for one in made:
        one.node.close()
        one.server.close()
    rclpy.try_shutdown()


def test_a_laser_without_compensation_in_a_cell_with_sensors(instrument):
    laser = instrument(InterferometerNode, LASER, "compensation:=own", "dead_path:=0.25")
    laser.connect()
    laser.await_state("active")
    # Without weather the count is there, and nothing is invented.
    reading = laser.read("1.5,OK")
    assert reading.raw_displacement == pytest.approx(1.5e-3) and isnan(
        reading.compensated_displacement
    )
    laser.until(lambda: "air is not known" in laser.diagnostic("compensation")[0])

    laser.tell_weather(AIR, lambda: laser.diagnostic("weather") == _KNOWN)
    laser.begin_run()
    plan = load_plan("quick")[0]
    assert plan.lines[0].name == "x"
    # An operator still works at the beam: nothing is zeroed, and a lost beam is no loss.
    laser.run_state(State.WAITING_FOR_SETUP)
    assert laser.read("---,E1").status == 2
    assert laser.read("700,OK").raw_displacement == pytest.approx(0.7)
    laser.run_state(State.RUNNING)
    laser.until(lambda: laser.node._setup == "x")
    first = laser.read("700,OK")
    assert (first.raw_displacement, first.status) == (0.0, 0)
    assert first.compensated_displacement == 0.0
    reading = laser.read("710,OK")
    assert reading.compensated_displacement == pytest.approx(0.01 / index_of(AIR), rel=1e-12)
    assert reading.air_temperature == 21.0 and reading.material_temperature == 20.5

    # Another air: the displacement of the machine is the same, that of the dead path is gone.
    cold = AIR._replace(air_temperature=19.0, air_pressure=100_900.0)
    laser.tell_weather(cold, lambda: environment_of(laser.read("710,OK")) == cold)
    change = index_of(cold) - index_of(AIR)
    expected = (0.01 - change * 0.25) / index_of(cold)
    assert laser.read("710,OK").compensated_displacement == pytest.approx(expected, abs=1e-14)

    # A station that is set to another unit is not believed, and says so in words.
    wrong = cold._replace(air_pressure=1009.0)
    laser.tell_weather(wrong, lambda: "it would fit in hPa" in laser.diagnostic("weather")[0])
    reading = laser.read("710,OK")
    assert isnan(reading.compensated_displacement) and isnan(reading.air_pressure)
    laser.tell_weather(cold, lambda: laser.diagnostic("weather") == _KNOWN)
    assert not isnan(laser.read("710,OK").compensated_displacement)

    # The count is lost now, and stays lost.
    assert [laser.read(line).status for line in ("---,E1", "710,OK")] == [2, 2]
    # Lost power: the device is closed, and opened anew when it is there again.
    laser.hang_up()
    laser.await_state("unconfigured", "cannot read the interferometer: the link socket://")
    laser.connect()
    laser.await_state("active")
    reading = laser.read("5,OK")
    assert (reading.sequence, reading.raw_displacement) == (0, 5e-3)


_KNOWN = ("air and material are known", 0)


def test_who_compensates_is_chosen_while_the_device_is_closed(instrument):
    laser = instrument(InterferometerNode, LASER, "compensation:=instrument")
    laser.connect()
    laser.await_state("active")
    laser.read("1.5,OK")
    laser.tell_weather(
        AIR, lambda: "set the parameter compensation to own" in laser.diagnostic("compensation")[0]
    )

    def set_to(value):
        parameter = rclpy.parameter.Parameter("compensation", value=value)
        return laser.node.set_parameters([parameter])[0]

    assert "compensation" in set_to("off").reason and not set_to("off").successful
    assert laser.change(label="deactivate") and laser.change(label="cleanup")
    assert set_to("off").successful
    laser.hang_up()
    assert laser.change(label="configure") and laser.change(label="activate")
    laser.connect()
    laser.await_state("active")
    reading = laser.read("1.5,OK")
    assert reading.compensated_displacement == reading.raw_displacement
    laser.until(lambda: "as it was asked for" in laser.diagnostic("compensation")[0])


@pytest.mark.parametrize("node", [InterferometerNode, WeatherNode])
def test_a_wrong_setting_is_named_with_its_file(node, tmp_path):
    file = tmp_path / "ours.yaml"
    file.write_text("connection: {url: loop://, sped: 9}\n")
    for given, words in (
        ([f"device_file:={file}"], a_fault("unknown", str(file), "connection", about="sped")),
        ([], a_fault("missing", "device_file", about="url")),
        (
            ["device:=line_protocoll", f"device_file:={file}"],
            a_fault("unknown", "line_protocol", about="device"),
        ),
    ):
        parameters = [word for one in ["device:=line_protocol", *given] for word in ("-p", one)]
        rclpy.init(args=["--ros-args", *parameters])
        try:
            with refused(Refusal, words):
                node()
        finally:
            rclpy.try_shutdown()


def test_a_station_tells_only_what_it_knows(instrument):
    station = instrument(WeatherNode, STATION)
    heard = {name: station.hear(topic) for name, (topic, _) in topics.WEATHER.items()}
    station.connect()
    station.await_state("active")
    station.say("20.5,1005.0,45\n")
    station.until(lambda: heard["relative_humidity"])
    assert heard["air_temperature"][-1].temperature == 20.5
    assert heard["air_pressure"][-1].fluid_pressure == 100_500.0
    assert heard["relative_humidity"][-1].relative_humidity == 0.45
    before = {name: len(messages) for name, messages in heard.items()}
    assert before["material_temperature"] == 0
    station.say("20.6,err,46\n")
    station.until(lambda: len(heard["relative_humidity"]) > before["relative_humidity"])
    assert len(heard["air_pressure"]) == before["air_pressure"]
    # A thermometer that was set to Fahrenheit.
    station.say("69.1,1005.0,45\n")
    station.until(lambda: "it would fit in degF" in station.diagnostic("sensors")[0])
