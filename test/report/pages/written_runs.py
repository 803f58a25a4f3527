"""Bags of lines that a test has changed."""

from dataclasses import replace

import numpy as np
from standard_runs import message_of, write_messages


def write_lines(path, plan_text, lines, machine_text=""):
    """Write a bag of some lines of a plan."""
    write_messages(path, map(message_of, lines), plan_text, machine_text)


def with_backlash_of_x(measurement, lost_motion):
    """Return lines in which X stays behind by half the lost motion, in the sense of its moves."""
    step = np.asarray(measurement.volume.step)
    sense, before, zeros, lines = 0.0, None, {}, []
    for line in measurement.lines:
        name = line.line.name
        along = {"x": 1.0, "y": 0.0, "z": 0.0}.get(name)
        if along is None:
            along = (-1.0 if name[0] == "n" else 1.0) * step[0] / np.linalg.norm(step)
        changes = np.zeros(len(line.displacement))
        for stop, target in enumerate(line.target):
            if stop == 0 and line.overrun > 0.0 and along == 1.0:
                # Begun from beyond: the first stop is approached in the sense of the pass.
                sense = 1.0 if line.line.direction == "forward" else -1.0
            elif before is not None and target[0] != before:
                sense = np.sign(target[0] - before)
            before = target[0]
            changes[stop] = -0.5 * lost_motion * sense * along
        zero = zeros.setdefault(line.setup, changes[0])
        lines.append(replace(line, displacement=line.displacement + changes - zero))
    return lines
