"""Lines of Grbl as values, and a set-up that is read or refused."""

import pytest
from grbl_peer import SETTINGS
from hypothesis import given
from hypothesis import strategies as st
from refused import a_fault, refused

from stepdiag_ros.devices.cnc.grbl_move import line_of_move
from stepdiag_ros.devices.cnc.grbl_protocol import (
    Activity,
    Alarm,
    Banner,
    Garbage,
    GrblSetting,
    LineAnswer,
    Message,
    StartupBlock,
    moves,
    read_line,
)
from stepdiag_ros.devices.cnc.grbl_setup import GrblSettings, read_setup
from stepdiag_ros.metrology.machine import Machine
from stepdiag_ros.metrology.refusal import Refusal

MACHINE = Machine("m", "XYZ", (-0.4, -0.4, -0.4), (0.4, 0.4, 0.4), 0.5, 2.0)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("ok", LineAnswer(0)),
        ("error:22", LineAnswer(22)),
        ("ALARM:3", Alarm(3)),
        ("Grbl 1.1h ['$' for help]", Banner("Grbl 1.1h ['$' for help]")),
        (
            "GrblHAL 1.1f ['$' or '$HELP' for help]",
            Banner("GrblHAL 1.1f ['$' or '$HELP' for help]"),
        ),
        ("$130=200.000", GrblSetting(130, "200.000")),
        ("$N0=G54", StartupBlock(0, "G54")),
        ("[VER:1.1h.20190830:lathe]", Message("VER", "1.1h.20190830:lathe")),
        (">G54G20:ok", Message("startup", "G54G20:ok")),
        ("okk", Garbage("okk")),
        ("<Idle|MPos:1.0,2.0|FS:0,0>", Garbage("<Idle|MPos:1.0,2.0|FS:0,0>")),
        ("<Idle|FS:0,0>", Garbage("<Idle|FS:0,0>")),
        ("<Idl|MPos:1.0,2.0,3.0>", Garbage("<Idl|MPos:1.0,2.0,3.0>")),
        ("<Idle|MPos:1.0,2.-0,3.0>", Garbage("<Idle|MPos:1.0,2.-0,3.0>")),
        ("<Idle|MPos:1.0,nan,3.0>", Garbage("<Idle|MPos:1.0,nan,3.0>")),
        ("<Idle|MPos:1.0,2.0,3.0", Garbage("<Idle|MPos:1.0,2.0,3.0")),
    ],
)
def test_what_a_line_says(line, said):
    assert read_line(line.encode()) == said


def test_a_report_with_everything_in_it():
    report = read_line(
        b"<Hold:1|WPos:-2.500,0.000,11.000,5.0|Bf:15,128|FS:500,8000|Pn:XZ|WCO:1.0,2.0,-3.5|"
        b"Ov:80,100,100|A:SF|H:0,3>"
    )
    assert (report.activity, report.part, report.at_rest) == (Activity.HOLD, 1, False)
    assert (report.machine, report.work) == (None, (-2.5, 0.0, 11.0))
    assert (report.offset, report.pins) == ((1.0, 2.0, -3.5), "XZ")
    assert (report.feed_override, report.homed) == (80, False)


def test_a_whole_report_after_half_a_line_is_read():
    report = read_line(b"<Run|MPos:1.0,2.<Idle|MPos:4.000,5.000,6.000|FS:0,0>")
    assert report.activity is Activity.IDLE
    assert report.machine == (4.0, 5.0, 6.0)


@given(st.binary(max_size=120))
def test_no_line_brings_the_reader_down(line):
    read_line(line)
    read_line(b"<Idle|MPos:" + line + b">")


@pytest.mark.parametrize(
    ("code", "does"),
    [
        ("G54", False),
        ("G20 G17", False),
        ("(home X5) G54 ;X1", False),
        ("G10L2P1X5Y5", False),
        ("G92X0", False),
        ("G28.1", False),
        ("M3S1000", False),
        ("G0X5", True),
        ("x5", True),
        ("G28", True),
        ("G30", True),
        ("G1 Z-1.5 F100", True),
        ("G38.2Z-5F10", True),
    ],
)
def test_start_up_blocks_that_move_are_known(code, does):
    assert moves(code) is does


def test_the_line_of_a_move_names_only_the_axes_that_may_move():
    assert line_of_move((0.0123456, -0.5, 0.0), 0.01, "X") == "G90G94G21G53G1X12.3456F600"
    assert line_of_move((-1e-9, -0.5, 0.1), 1 / 60e3, "XYZ") == "G90G94G21G53G1X0Y-500Z100F1"


def read(startup=None, options="V,15,128", machine=MACHINE, without_homing=True, **changed):
    settings = {k: str(v) for k, v in SETTINGS.items()}
    settings |= {int(key[1:]): value for key, value in changed.items()}
    return read_setup(
        settings,
        {"OPT": options, "VER": "1.1h.20190830:mill"},
        startup or {},
        machine,
        without_homing=without_homing,
    )


def test_the_limits_are_those_of_file_and_controller_together():
    assert read().low == (-0.4, -0.4, -0.4)
    soft = read(_20="1", _22="1")
    assert soft.low == pytest.approx((-0.4, -0.4, -0.3))
    assert soft.high == (0.0, 0.0, 0.0)
    # Hard limits: grblHAL keeps off the switches by the pull-off.
    kept = read(_20="1", _21="1", _22="1")
    assert kept.low[2] == pytest.approx(-0.299)
    assert kept.high == pytest.approx((-1e-3, -1e-3, -1e-3))
    # Zero at the switch: an axis that homes downwards has positive coordinates.
    for options, homing in (("VZ,15,128", "1"), ("V,15,128", "9")):
        zero = read(options=options, _20="1", _22=homing, _23="2")
        assert zero.low == pytest.approx((-0.4, 0.0, -0.3))
        assert zero.high == pytest.approx((0.0, 0.4, 0.0))


def test_what_the_bridge_is_told():
    told = read(_101="250.0", _111="600.0", _122="10.0")
    assert told.identity == "Grbl 1.1h.20190830:mill"
    assert told.traits.resolution == pytest.approx((1e-6, 4e-6, 1e-6))
    assert told.traits.acceleration == pytest.approx((2.0, 2.0, 0.01))
    assert told.traits.feed_limit[1] == pytest.approx(0.01)
    assert not told.traits.measured
    assert read(_13="1").traits.resolution[0] == pytest.approx(2.54e-6)
    assert read(_10="0").traits.resolution[0] == pytest.approx(2e-6)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"startup": {1: "G0X5"}}, a_fault("rejected", "$N1=G0X5)")),
        ({"without_homing": False}, a_fault("rejected", "$22=0", "without_homing")),
        ({"_100": "0.0"}, a_fault("out_of_range", "100=0", "steps/mm", "0")),
        ({"_110": "fast"}, a_fault("malformed", "110=fast")),
        (
            {"machine": Machine("m", "XYZ", (0.1, 0, 0), (0.4, 1, 1), 1, 1), "_20": "1"},
            a_fault("mismatch", "X", "-0.5", "0", "$130"),
        ),
    ],
)
def test_a_set_up_that_must_not_be_used_is_refused(changed, words):
    with refused(Refusal, words):
        read(**changed)


def test_a_controller_without_a_setting_is_refused():
    with refused(Refusal, "missing", "$22", "1.1"):
        read_setup({}, {}, {}, MACHINE, without_homing=True)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({}, a_fault("missing", about="url")),
        ({"connection": {"url": "host:23"}}, a_fault("malformed", "socket://host:23")),
        (
            {"connection": {"url": "x"}, "report_rate_hz": 1},
            a_fault("out_of_range", "1", about="report_rate_hz"),
        ),
        ({"connection": {"url": "x"}, "homing": True}, a_fault("unknown", about="homing")),
    ],
)
def test_wrong_settings_are_refused_without_a_device(settings, words):
    with refused(Refusal, words):
        GrblSettings.from_mapping(settings)
