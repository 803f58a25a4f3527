"""What becomes of the machine when the agent in LinuxCNC, or LinuxCNC's own task, dies."""

import contextlib
import errno
import os
import time
from pathlib import Path

import pytest
from linuxcnc_watched import SLOW, Watched, at_rest
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


WATCHDOG_S = 2.0
"""Of LinuxCNC's own time: where a busy computer lets LinuxCNC wait, axes and watchdog wait."""
RUN_ON_MM = 1e3 * SLOW * WATCHDOG_S + 10.0
"""What an axis does at most once the agent is silent; and what it did in half a second before,
in which a busy computer has let the agent wait between its last word and its last sign of life."""


def watch_closely(instance, watched):
    """Let the watchdog be quick from the next signs of life on; 0.5 s is what users get.

    The agent must give these signs, and LinuxCNC must run while it does: each may have to wait.
    Where a busy computer lets the agent wait until the watchdog acts, the move begins again.
    """

    def set_timeout(seconds):
        command = ("halcmd", "setp", "watchdog.timeout-0", repr(seconds))
        watched.meanwhile(lambda: instance.run(*command))

    set_timeout(WATCHDOG_S)
    while not all(moves_on(watched) for _ in range(2)):
        set_timeout(10.0)
        watched.reset()
        watched.go(800.0, 0.0, 0.0, feed=SLOW)
        watched.until_moved()
        set_timeout(WATCHDOG_S)


def moves_on(watched):
    """Wait until the axes have moved by 2 mm, and return whether they have: not with a fault."""
    begun = watched.samples()[-1].position[0]

    def decided():
        faulty = watched.driver.state is CncState.FAULT
        return faulty or abs(watched.samples()[-1].position[0] - begun) > 2e-3

    watched.until(decided)
    return watched.driver.state is not CncState.FAULT


def last_told(watched):
    """Return where X was by the last word of the agent, mm."""
    return 1e3 * watched.samples()[-1].position[0]


def stands(watched, at):
    """Return whether the lag of the drives has passed: X and its motor stand, X where it is to."""
    two = watched.samples()[-2:]
    same = two[0].position == two[-1].position and two[0].motors == two[-1].motors
    return same and abs(two[-1].position[0] - at) < 2e-9


def hang(instance):
    """Stop the agent, but not within HAL: it would hold a lock there that halcmd waits for.

    It holds none in a system call, which a stopped process is in by the word of Linux.
    """
    while True:
        instance.signal("STOP", "stepdiag_agent")
        pid = instance.run("pgrep", "-f", "stepdiag_agent").split()[0]
        if not instance.run("cat", f"/proc/{pid}/syscall").startswith("-1"):
            return
        instance.signal("CONT", "stepdiag_agent")


def kill(instance):
    """Kill the agent, but not within HAL: nobody would free the lock, and halcmd waits for ever."""
    hang(instance)
    instance.signal("KILL", "stepdiag_agent")


def until_inhibited(instance):
    end = time.monotonic() + PATIENCE
    while "TRUE" not in instance.run("halcmd", "getp", "motion.feed-inhibit"):
        assert time.monotonic() < end, "the feed is not inhibited"


def test_a_move_that_the_watchdog_has_held_is_a_fault_when_the_agent_goes_on(make_instance):
    instance = make_instance()
    watched = Watched(instance.socket)
    watched.reset()
    watched.go(800.0, 0.0, 0.0, feed=SLOW)
    watched.until_moved()
    watch_closely(instance, watched)
    watched.meanwhile(lambda: hang(instance))
    watched.meanwhile(lambda: until_inhibited(instance))
    last = last_told(watched)
    watched.meanwhile(lambda: instance.signal("CONT", "stepdiag_agent"))
    fault = watched.until_state(CncState.FAULT, CncState.READY, CncState.STOPPED)
    assert fault.state is CncState.FAULT and "watchdog" in fault.reason
    assert 1e3 * fault.position[0] - last < RUN_ON_MM
    # Nobody but an operator lets it go on, and then the feed is there again.
    instance.run("halcmd", "setp", "watchdog.timeout-0", "10")
    watched.reset()
    watched.go(0.0, 0.0, 0.0, feed=0.4)
    assert watched.until_state(CncState.READY, CncState.FAULT).state is CncState.READY
    watched.driver.close()
    instance.stop()


def test_an_agent_that_hangs_inhibits_the_feed_and_is_told(make_instance):
    instance = make_instance()
    watched = Watched(instance.socket)
    watched.reset()
    watched.go(800.0, 0.0, 0.0, feed=SLOW)
    watched.until_moved()
    watch_closely(instance, watched)
    watched.meanwhile(lambda: hang(instance))
    with refused(OSError, None, "20", errno=errno.ETIMEDOUT):
        watched.wait(PATIENCE)
    watched.driver.close()
    first = at_rest(instance)
    assert first - last_told(watched) < RUN_ON_MM
    with refused(OSError, errno=errno.ETIMEDOUT):
        Watched(instance.socket, silence=0.5)
    instance.run("halcmd", "setp", "watchdog.timeout-0", "10")
    instance.signal("CONT", "stepdiag_agent")
    again = Watched(instance.socket, patience=PATIENCE)
    # HAL takes back the watchdog's word a moment after the agent has: both hold the machine.
    again.until(lambda: again.driver.state in (CncState.STOPPED, CncState.FAULT))
    assert at_rest(instance) < first + 1.0, "the old move goes on"
    again.reset()
    again.go(0.0, 0.0, 0.0, feed=0.4)
    again.until_state(CncState.READY)
    # LinuxCNC's own task dies: nobody but HAL can brake now.
    again.go(800.0, 0.0, 0.0, feed=SLOW)
    again.until_moved()
    again.meanwhile(lambda: instance.signal("KILL", "milltask -ini"))
    fault = again.until_state(CncState.FAULT)
    assert "milltask has died" in fault.reason
    # The fault is told when HAL brakes; the move is of 800 mm.
    assert at_rest(instance) - last_told(again) < 10.0
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
        watched.until(lambda at=1e-3 * target: stands(watched, at))
        axes.append(watched.samples()[-1])
    assert axes[1].motors[0] == pytest.approx(0.020 - 2e-6, abs=2e-9)
    assert axes[2].motors[0] == pytest.approx(0.010 + 2e-6, abs=2e-9)
    assert axes[2].position[0] == pytest.approx(0.010, abs=2e-9)
    watched.go(800.0, 0.0, 0.0, feed=SLOW)
    watched.until_moved()
    with refused(OSError, errno=errno.ECONNRESET):
        watched.meanwhile(lambda: kill(instance))
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
    watched.go(800.0, *(1e3 * value for value in watched.position()[1:]), feed=SLOW)
    watched.until_moved()
    watch_closely(instance, watched)
    with refused(OSError, errno=errno.ECONNRESET):
        watched.meanwhile(lambda: kill(instance))
        watched.wait(PATIENCE)
    watched.driver.close()
    until_inhibited(instance)
    assert at_rest(instance) - last_told(watched) < RUN_ON_MM
    agent = str(instance.socket.parent / "linuxcnc_agent" / "stepdiag_agent.py")
    with refused(OSError, None, "stepdiag"):
        instance.run(agent, "-ini", "machine.ini")
    instance.stop()
