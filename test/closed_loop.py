"""Closed loops: measure a machine, compensate it, measure again; judged by the machine's own truth.

The imperfect machine is a twin that only the laser sees. "Before" and "after" are its errors at the
places where its motors stood while the laser read, so the estimate that a compensation was made
from is judged, not repeated.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stepdiag_ros import topics
from stepdiag_ros.bags.folder import open_bag
from stepdiag_ros.bags.run import RecordedRun, load_run
from stepdiag_ros.bags.runs import messages_of
from stepdiag_ros.cli import main
from stepdiag_ros.configuration import cell_from_text
from stepdiag_ros.messages import conversion
from stepdiag_ros.messages.fields import to_nanoseconds
from stepdiag_ros.metrology.forward import tool_point
from stepdiag_ros.metrology.plan import LINEAR

ORIGIN, STEP, BLOCKS = 0.005, 0.01, 4
PLAN = f"""\
name: closed loop
origin_m: [{ORIGIN}, {ORIGIN}, {ORIGIN}]
step_m: [{STEP}, {STEP}, {STEP}]
blocks: {BLOCKS}
repeats: 1
directions: [forward]
feed_m_per_s: 0.2
pause_for_setup: false
lines:
  - kind: linear
    names: [x, y, z]
DIAGONALS
sampling:
  dwell_s: 0.2
  settle_s: 0.1
  window_s: 0.15
"""
DIAGONALS = """\
  - kind: step_diagonal
    names: [ppp, npp, pnp, ppn]
    orders: [XYZ]
"""
NOISE, RATE = 5e-9, 50.0
"""m and Hz: of the readings; a window of 0.15 s makes 2 nm of it; faster is of no use here."""


def twin() -> str:
    """Return a machine with scale errors, bent screws, bent ways and bad squareness."""
    nodes = np.linspace(0.0, 0.05, 51)
    u = nodes / 0.05
    curves = {
        "E_XX": 14e-6 * u + 0.9e-6 * u**2,
        "E_YY": -11e-6 * u + 0.8e-6 * np.sin(2.0 * u),
        "E_ZZ": 12e-6 * u - 0.7e-6 * u**3,
        "E_YX": 1.5e-6 * u * (1 - u),
        "E_ZX": -1.2e-6 * u * (1 - u),
        "E_XY": 0.8e-6 * np.sin(3.0 * u),
        "E_ZY": 1.0e-6 * u**2,
        "E_XZ": -0.9e-6 * u**2,
        "E_YZ": 0.7e-6 * u * (1 - u),
    }
    return json.dumps(
        {
            "name": "imperfect twin",
            "seed": 5,
            "chain": "YXZ",
            "errors": {
                "nodes_m": dict.fromkeys("XYZ", nodes.tolist()),
                "curves": {name: curve.tolist() for name, curve in curves.items()},
                "squareness_rad": {"C0Y": 150e-6, "B0Z": -120e-6, "A0Z": 90e-6},
            },
            "misalignment": {"beam_sigma_rad": 100e-6, "mirror_sigma_rad": 10e-6},
            "reading_noise_m": NOISE,
            "reading_rate_hz": RATE,
        }
    )


@dataclass(frozen=True)
class Stood:
    """Where the motors stood at the stops of a run, where they should have, and what was told.

    ``beyond``: displacement of the tool that is not in the cell's error curves, of places; m.
    """

    run: RecordedRun
    target: np.ndarray
    motors: np.ndarray
    linear: np.ndarray
    told: np.ndarray
    beyond: Callable[[np.ndarray], np.ndarray] | None = None

    def tool_errors(self) -> np.ndarray:
        cell = cell_from_text(self.run.cell_text, "cell")
        moved = 0.0 if self.beyond is None else self.beyond(self.motors)
        return tool_point(self.motors, cell.errors, cell.chain)[0] + moved - self.target

    def positioning(self) -> list[float]:
        """Return the range of the true positioning error of each axis along its linear line."""
        errors = self.tool_errors()
        return [float(np.ptp(errors[self.linear == axis, axis])) for axis in range(3)]

    def volume(self) -> float:
        """Return the rms true error of the volume, turned and shifted as a workpiece may be."""
        errors = self.tool_errors()
        turns = [np.cross(axis, self.target) for axis in np.eye(3)]
        shifts = [np.tile(axis, (len(self.target), 1)) for axis in np.eye(3)]
        rigid = np.stack([part.ravel() for part in (*turns, *shifts)], axis=1)
        weights, *_ = np.linalg.lstsq(rigid, errors.ravel(), rcond=None)
        left = errors.ravel() - rigid @ weights
        return float(np.sqrt(np.mean(np.sum(left.reshape(-1, 3) ** 2, axis=1))))


def stood(bag: Path) -> Stood:
    run = load_run(bag)
    times, motors = [], []
    name = topics.absolute(topics.JOINT_STATES, run.namespace)
    with open_bag(bag) as opened:
        for _, message in messages_of(opened, run.found, (name,)):
            # Where the controller compensates, the motors stand elsewhere than it says.
            place = conversion.motor_positions(message) or conversion.axis_positions(message)
            assert place is not None
            times.append(to_nanoseconds(message.header.stamp))
            motors.append(place)
    times, motors = np.array(times), np.array(motors)
    last = {line.line_index: line.attempt for line in run.measurement.lines}
    # On a busy computer a line may have been measured again.
    stops = [one for one in run.stops if one.command.attempt == last[one.command.line_index]]
    assert all(stop.settled for stop in stops)
    where = [place_at(stop, times, motors) for stop in stops]
    linear = ["xyz".index(stop.line.name) if stop.line.kind == LINEAR else -1 for stop in stops]
    target = np.array([stop.command.target for stop in stops])
    told = np.array([stop.position for stop in stops])
    return Stood(run, target, np.array(where), np.array(linear), told)


def place_at(stop, times: np.ndarray, motors: np.ndarray) -> np.ndarray:
    """Return where the motors stood while the laser read."""
    within = (times >= stop.window_start) & (times <= stop.window_end)
    if within.any():
        return np.mean(motors[within], axis=0)
    # A computer that was busy for a moment told no position then; the machine stood before too.
    last = np.searchsorted(times, stop.window_end) - 1
    assert times[last] >= stop.in_position_time
    return motors[last]


def files_of(folder: Path, whole: bool = True) -> tuple[Path, Path]:
    """Write the plan, with diagonals if it is to be whole, and the twin; return their files."""
    folder.mkdir()
    plan, cell = folder / "plan.yaml", folder / "cell.yaml"
    plan.write_text(PLAN.replace("DIAGONALS\n", DIAGONALS if whole else ""))
    cell.write_text(twin())
    return plan, cell


def compensate(bag: Path, control: str, folder: Path, *more: str) -> Path:
    options = ["--for", control, "--output", str(folder), "--pictures", "none", *more]
    assert main(["compensate", str(bag), *options]) == 0
    return folder
