"""A real LinuxCNC with simulated drives, isolated; one for all tests of a module."""

import os
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from linuxcnc_watched import Watched
from patience import PATIENCE

from stepdiag_ros.devices.cnc import CncState
from stepdiag_ros.devices.cnc.linuxcnc_instance import LinuxCncInstance, missing


@pytest.fixture(scope="session")
def linuxcnc_is_there() -> None:
    reason = missing()
    if reason and os.environ.get("CI"):
        pytest.fail(f"LinuxCNC must be tested in CI: {reason}")
    if reason:
        pytest.skip(f"no LinuxCNC here: {reason}")


@pytest.fixture(scope="module")
def make_instance(linuxcnc_is_there: None) -> Iterator[Callable[..., LinuxCncInstance]]:  # noqa: ARG001
    # Of one module: a LinuxCNC that runs on takes a tenth of a processor from all tests after it.
    made = []
    # Short, since sockets lie there.
    with tempfile.TemporaryDirectory(prefix="lc") as folder:

        def make(watchdog_s: float = 10.0, **options) -> LinuxCncInstance:
            # A busy computer is no silent agent.
            place = Path(folder) / str(len(made))
            made.append(LinuxCncInstance(place, watchdog_s=watchdog_s, **options))
            made[-1].start()
            return made[-1]

        yield make
        for instance in made:
            instance.stop()


@pytest.fixture(scope="module")
def machine_tool(make_instance) -> LinuxCncInstance:
    return make_instance()


@pytest.fixture
def watched(machine_tool) -> Iterator[Watched]:
    """The driver, allowed to move, with the machine at 0, 0, 0."""
    made = Watched(machine_tool.socket, patience=PATIENCE)
    made.reset()
    for number, axis in enumerate("XYZ"):
        there = [1e3 * value for value in made.position()]
        there[number] = 0.0
        made.go(*there, feed=0.4, axes=axis)
        made.until_state(CncState.READY)
    made.events.clear()
    yield made
    made.driver.close()
