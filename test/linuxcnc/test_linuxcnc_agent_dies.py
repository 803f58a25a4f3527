"""What becomes of the machine when the agent in LinuxCNC, or LinuxCNC's own task, dies."""

import contextlib
import errno
import os
import time
from pathlib import Path

import pytest
from linuxcnc_watched import Watched, at_rest
from patience import PATIENCE
from refused import refused

from stepdiag_ros.devices.cnc import CncState, MoveRefused

pytestmark = pytest.mark.timeout(2 * PATIENCE)


def namespaces(folder=""):
    """Return the PID namespaces of processes whose command line names a folder, without ours."""
    found = set()
    for entry in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            if folder in (entry / "cmdline").read_bytes().decode(errors="replace"):
                found.add(os.readlink(entry / "ns" / "pid"))  # noqa: PTH115 - it is no path
    return found - {os.readlink("/proc/self/ns/pid")}  # noqa: PTH115


def watch_closely(instance, watched):
    """Let the watchdog be as quick as the one that users get, from the next signs of life on."""
    instance.run("halcmd", "setp", "watchdog.timeout-0", "0.5")
    for _ in range(5):
        watched.position()


def is_inhibited(instance):
    return "TRUE" in instance.run("halcmd", "getp", "motion.feed-inhibit")


def test_a_move_that_the_watchdog_has_held_is_a_fault_when_the_agent_goes_on(make_instance):
    instance = make_instance()
    watched = Watched(instance.socket)
    watched.reset()
    watched.go(800.0, 0.0, 0.0)
    watched.until_moved()
    watch_closely(instance, watched)
    instance.signal("STOP", "stepdiag_agent")
    watched.until(lambda: is_inhibited(instance))
    instance.signal("CONT", "stepdiag_agent")
    fault = watched.until_state(CncState.FAULT, CncState.READY, CncState.STOPPED)
    assert fault.state is CncState.FAULT and "watchdog" in fault.reason
    assert fault.position[0] < 0.3
    # Nobody but an operator lets it go on, and then the feed is there again.
    instance.run("halcmd", "setp", "watchdog.timeout-0", "10")
    watched.reset()
    watched.go(0.0, 0.0, 0.0, feed=0.4)
    assert watched.until_state(CncState.READY, CncState.FAULT).state is CncState.READY
    watched.driver.close()
    instance.stop()


def test_an_agent_that_hangs_inhibits_the_feed_and_is_told(make_instance):
    instance = make_instance()
    watched = Watched(instance.socket, silence=5.0)
    watched.reset()
    watched.go(800.0, 0.0, 0.0)
    watched.until_moved()
    watch_closely(instance, watched)
    instance.signal("STOP", "stepdiag_agent")
    with refused(OSError, None, "5", errno=errno.ETIMEDOUT):
        watched.wait(PATIENCE)
    watched.driver.close()
    # The watchdog in HAL: 0.5 s at 0.1 m/s and the braking.
    first = at_rest(instance)
    assert first < 90.0
    with refused(OSError, errno=errno.ETIMEDOUT):
        Watched(instance.socket, silence=0.5)
    instance.run("halcmd", "setp", "watchdog.timeout-0", "10")
    instance.signal("CONT", "stepdiag_agent")
    time.sleep(0.3)
    assert float(instance.run("halcmd", "getp", "joint.0.motor-pos-fb")) < first + 1.0
    again = Watched(instance.socket)
    assert again.until_state(CncState.STOPPED)
    again.reset()
    again.go(0.0, 0.0, 0.0, feed=0.4)
    again.until_state(CncState.READY)
    # LinuxCNC's own task dies: nobody but HAL can brake now.
    again.go(800.0, 0.0, 0.0)
    again.until_moved()
    instance.signal("KILL", "milltask -ini")
    fault = again.until_state(CncState.FAULT)
    assert "milltask has died" in fault.reason
    assert at_rest(instance) < 100.0
    with refused(MoveRefused, "rejected", "milltask"):
        again.driver.reset(time.time_ns())
    again.driver.close()


def test_an_agent_that_is_killed_is_an_os_error_and_nothing_is_left_of_the_instance(make_instance):
    instance = make_instance(lost_motion_m=(4e-6, 0.0, 0.0))
    watched = Watched(instance.socket)
    watched.until_state(CncState.READY)
    with refused(MoveRefused, "rejected"):
        watched.go(5.0, 0.0, 0.0)
    watched.reset()
    # Lost motion: the motor is where it was told to be, the axis half of it behind.
    axes = []
    for target in (10.0, 20.0, 10.0):
        watched.go(target, 0.0, 0.0)
        watched.until_state(CncState.READY)
        watched.wait(0.15)
        axes.append(watched.samples()[-1])
    assert axes[1].motors[0] == pytest.approx(0.020 - 2e-6, abs=2e-9)
    assert axes[2].motors[0] == pytest.approx(0.010 + 2e-6, abs=2e-9)
    assert axes[2].position[0] == pytest.approx(0.010, abs=2e-9)
    watched.go(800.0, 0.0, 0.0)
    watched.until_moved()
    instance.signal("KILL", "stepdiag_agent")
    with refused(OSError, errno=errno.ECONNRESET):
        watched.wait(PATIENCE)
    watched.driver.close()
    with refused(OSError, errno=errno.ECONNREFUSED):
        Watched(instance.socket)
    instance.start()
    own = namespaces(str(instance.socket.parent))
    assert len(own) == 1
    again = Watched(instance.socket)
    again.until_state(CncState.READY)
    instance.stop()
    with refused(OSError, errno=errno.ECONNRESET):
        again.wait(PATIENCE)
    again.driver.close()
    deadline = time.monotonic() + PATIENCE
    while left := [path for path in namespaces() if path in own]:
        assert time.monotonic() < deadline, f"left behind: {left}"
        time.sleep(0.05)


def test_an_agent_that_dies_beside_another_display_inhibits_the_feed(make_instance):
    instance = make_instance(beside=True)
    watched = Watched(instance.socket)
    watched.reset()
    # Its messages belong to the other display, but that a move was not made is told all the same.
    instance.freeze("X")
    watched.go(100.0, 0.0, 0.0)
    assert watched.until_state(CncState.FAULT).reason == "the machine is switched off"
    instance.thaw("X")
    instance.operate("STATE_ON")
    watched.wait(0.3)
    watched.reset()
    here = 1e3 * watched.position()[0]
    watched.go(800.0, *(1e3 * value for value in watched.position()[1:]))
    watched.until_moved()
    watch_closely(instance, watched)
    instance.signal("KILL", "stepdiag_agent")
    with refused(OSError, errno=errno.ECONNRESET):
        watched.wait(PATIENCE)
    watched.driver.close()
    end = time.monotonic() + PATIENCE
    while not is_inhibited(instance):
        assert time.monotonic() < end
    assert at_rest(instance) < here + 300.0
    agent = str(instance.socket.parent / "linuxcnc_agent" / "stepdiag_agent.py")
    with refused(OSError, None, "stepdiag"):
        instance.run(agent, "-ini", "machine.ini")
    instance.stop()
