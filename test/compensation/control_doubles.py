"""Controls that read tables as their manuals say, written apart from the package's own readers.

Each takes the files of a control and returns a function from commanded positions (m) to where the
axes really go; ``sense`` is +1 where every axis comes from below, -1 from above.
"""

import re

import numpy as np


def linuxcnc(files):
    """Motor command = commanded + what the table of the joint says, linear, constant beyond."""
    kinds = re.findall(r"COMP_FILE = (\S+)\nCOMP_FILE_TYPE = (\d)", files["joints.ini"])
    tables = {}
    for name, kind in kinds:
        rows = np.array([[float(v) for v in line.split()] for line in files[name].splitlines()])
        assert len(rows) <= 256 and np.all(np.diff(rows[:, 0]) > 0)
        if kind == "0":
            # Measured positions: what is too far is taken off.
            rows[:, 1:] = rows[:, :1] - rows[:, 1:]
        tables["xyz".index(name[0])] = rows
    unit = 25.4e-3 if "machine units: inch" in files["joints.ini"] else 1e-3

    def drive(commanded, sense):
        sent = commanded.copy()
        for axis, rows in tables.items():
            column = rows[:, 1 if sense > 0 else 2]
            sent[:, axis] += np.interp(commanded[:, axis] / unit, rows[:, 0], column) * unit
        return sent

    return drive


def siemens(files):
    """A positive compensation value moves the axis in the negative direction."""
    axes = {"X1": 0, "Y1": 1, "Z1": 2}
    found = dict(re.findall(r"^(\$A\S+?\])=\(?([^)\n]+)\)?$", "".join(files.values()), re.M))

    def table(stem, index, count_key):
        low, high, step = (
            float(found[f"{stem}_{word}[{index}]"]) for word in ("MIN", "MAX", "STEP")
        )
        count = round((high - low) / step) + 1
        values = [float(found[f"{stem}[{count_key.format(n)}]"]) for n in range(count)]
        assert f"{stem}[{count_key.format(count)}]" not in found
        return low + step * np.arange(count), np.array(values)

    rows = []
    for name, axis in axes.items():
        rows.append((axis, axis, 0, *table("$AA_ENC_COMP", f"0,{name}", f"0,{{}},{name}")))
    index = 0
    while f"$AN_CEC_INPUT_AXIS[{index}]" in found:
        rows.append(
            (
                axes[found[f"$AN_CEC_INPUT_AXIS[{index}]"]],
                axes[found[f"$AN_CEC_OUTPUT_AXIS[{index}]"]],
                int(found[f"$AN_CEC_DIRECTION[{index}]"]),
                *table("$AN_CEC", f"{index}", f"{index},{{}}"),
            )
        )
        index += 1

    def drive(commanded, sense):
        sent = commanded.copy()
        for base, moved, direction, places, values in rows:
            if direction in (0, sense):
                sent[:, moved] -= np.interp(commanded[:, base] * 1e3, places, values) * 1e-3
        return sent

    return drive


def heidenhain(files):
    """The value is the error (positive: travel too long); the control takes it off."""
    rows = []
    for base, letter in enumerate("XYZ"):
        lines = files[f"{letter}.COM"].splitlines()
        assert lines[1].split() == ["NR", "AXISPOS", "X", "Y", "Z"] and len(lines) - 3 <= 256
        numbers = np.array([[float(v) for v in line.split()] for line in lines[2:-1]])
        assert numbers[:, 0].tolist() == list(range(len(numbers)))
        rows += [(base, moved, numbers[:, 1], numbers[:, 2 + moved]) for moved in range(3)]

    def drive(commanded, _sense):
        sent = commanded.copy()
        for base, moved, places, values in rows:
            sent[:, moved] -= np.interp(commanded[:, base] * 1e3, places, values) * 1e-3
        return sent

    return drive


def fanuc(files):
    """Go from the reference position to the place; a point's pulses are output in mid-section."""
    points = {int(n): int(v) for n, v in re.findall(r"N1(\d{4})P(-?\d+)", files["PITCH.TXT"])}
    text = files["parameters_3620.txt"]

    def parameter(number, letter):
        return float(re.search(rf"^{number} {letter} = (\S+)$", text, re.M)[1])

    axes = []
    for letter in "XYZ":
        reference, first, last, times, interval = (
            parameter(number, letter) for number in range(3620, 3625)
        )
        origin = float(re.search(rf"reference position of {letter}, mm: (\S+)", text)[1])
        unit = float(re.search(rf"detection unit of {letter}, µm: (\S+)", text)[1])
        assert first <= reference <= last and last - first < 128
        axes.append((int(reference), int(first), int(last), times, interval, origin, unit))

    def output(position, axis):
        reference, first, last, times, interval, origin, unit = axes[axis]
        pulses = 0
        for number in range(first, last + 1):
            middle = origin + (number - reference - 0.5) * interval
            if origin <= middle < position:
                pulses += points[number]
            elif position <= middle < origin:
                pulses -= points[number]
        return pulses * times * unit * 1e-6

    def drive(commanded, _sense):
        sent = commanded.copy()
        for axis in range(3):
            sent[:, axis] += [output(place * 1e3, axis) for place in commanded[:, axis]]
        return sent

    return drive


DOUBLES = {"linuxcnc": linuxcnc, "siemens": siemens, "heidenhain": heidenhain, "fanuc": fanuc}
