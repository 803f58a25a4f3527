"""One wrong reading is found on worst plausible machines, and none where nothing is wrong."""

from dataclasses import replace

import numpy as np
import pytest
from plausible_machines import draw

from stepdiag_ros.metrology.discrepancy import diagnose
from stepdiag_ros.metrology.discrepancy.wrong_reading import WrongReading


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("size", [0.0, -3e-6, 90e-6], ids=["nothing wrong", "-3 µm", "90 µm"])
def test_a_reading_that_is_off_is_named_and_no_other(seed, size):
    machine = draw(seed)
    run = machine.measure(machine.steps())
    random = np.random.default_rng(seed)
    number = int(random.integers(len(run.lines)))
    line = run.lines[number]
    stop = int(random.integers(1, len(line.displacement)))
    displacement = line.displacement.copy()
    displacement[stop] += size
    lines = list(run.lines)
    lines[number] = replace(line, displacement=displacement)
    found = diagnose(replace(run, lines=tuple(lines)))
    assert found.wrong_readings == ((WrongReading(number, stop, size).words(run),) if size else ())
