"""Tests of positioning of a run, computed from its lines and compared with those recorded."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from decimal import Decimal
from typing import TYPE_CHECKING

import numpy as np

from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.plan import LINEAR
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.standards.axis_test import all_runs, is_diagonal
from stepdiag_ros.metrology.standards.iso230_2 import PARAMETERS, PositioningTest, evaluate
from stepdiag_ros.metrology.standards.iso230_6 import (
    DiagonalGroup,
    diagonal_groups,
    volumetric_warning,
)
from stepdiag_ros.metrology.standards.positioning_uncertainty import UncertaintyDescription

if TYPE_CHECKING:
    from stepdiag_ros.bags.run import RecordedRun
    from stepdiag_ros.evaluation.recorded_run import Correct


@dataclass(frozen=True)
class Published:
    """Figures that somebody else printed for the same data.

    Attributes:
        source: what the user calls them.
        values: name of a parameter → value, m.
        resolution: name → half a unit of the last printed digit, m.
    """

    source: str
    values: Mapping[str, float]
    resolution: Mapping[str, float]

    @classmethod
    def from_numbers(cls, source: str, numbers: Mapping[str, float], unit: float) -> "Published":
        """Make it from numbers as printed.

        Args:
            source: what the user calls them.
            numbers: name of a parameter → value in the printed unit.
            unit: that unit, m.

        Raises:
            ValueError: a name that is not a parameter.
        """
        halves = {}
        for name, number in numbers.items():
            if name not in PARAMETERS:
                raise Refusal(
                    f"{source}: '{name}' is not a parameter of ISO 230-2; use"
                    f" {', '.join(PARAMETERS)}",
                    fault="unknown",
                )
            exponent = Decimal(repr(float(number))).as_tuple().exponent
            assert isinstance(exponent, int)
            halves[name] = 0.5 * 10.0**exponent * unit
        return cls(source, {name: value * unit for name, value in numbers.items()}, halves)

    def agrees(self, name: str, value: float) -> bool:
        """Say whether a value (m) is the printed one to its last digit, rounded or truncated."""
        printed, half = self.values[name], self.resolution[name] * (1.0 + 1e-6)
        rounded = abs(value - printed) <= half
        # Digits that were cut off leave a figure nearer to zero.
        beyond = (value - printed) * (np.sign(printed) or np.sign(value))
        return bool(rounded or 0.0 <= beyond < 2.0 * half)


@dataclass(frozen=True)
class PositioningReport:
    """Everything that is shown of the tests of one source.

    Attributes:
        tests: in the order of measurement.
        source: file that the data came from.
        run_id: identity of the run; empty if it has none.
        unknown: inputs of the uncertainty that are not known, in words.
        published: figures to compare with; None if there are none.
        equals_recorded: setup → whether the test equals the one in the bag bit for bit; tests
            without a recorded one are not there.
        corrected: how the readings were corrected to 20 °C, in words; empty if they were not.
    """

    tests: tuple[PositioningTest, ...]
    source: str
    run_id: str = ""
    unknown: tuple[str, ...] = ()
    published: Published | None = None
    equals_recorded: Mapping[str, bool] = field(default_factory=dict)
    corrected: tuple[str, ...] = ()

    @property
    def groups(self) -> tuple[DiagonalGroup, ...]:
        """Return E_d and B_d of the machine, of its body diagonals and of each face."""
        return diagonal_groups(self.tests)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Return what belongs to corrected readings and to diagonals, if there are any."""
        if any(is_diagonal(test.kind) for test in self.tests):
            return (*self.corrected, volumetric_warning(self.tests))
        return self.corrected


def tests_alone(measurement: Measurement) -> bool:
    """Say whether lines are a test by ISO 230-2 and nothing else: repeated lines along axes."""
    lines = [one.line for one in measurement.lines]
    setups = {one.setup for one in measurement.lines}
    axes = {line.name for line in lines}
    passes = {(line.name, line.direction) for line in lines}
    return (
        bool(lines)
        and all(line.kind == LINEAR for line in lines)
        and len(setups) == len(axes)
        and len(passes) < len(lines)
    )


def tests_of(measurement: Measurement, source: str = "", run_id: str = "") -> PositioningReport:
    """Evaluate all tests in lines of whose measuring conditions nothing is stated.

    Args:
        measurement: the lines.
        source: file that they came from.
        run_id: identity of the run.

    Raises:
        ValueError: runs of one setup have different targets.
    """
    known = UncertaintyDescription()
    tests = tuple(evaluate(one, known) for one in all_runs(measurement))
    return PositioningReport(tests, source, run_id, known.unknown())


def positioning_of(
    recorded: "RecordedRun",
    description: UncertaintyDescription | None = None,
    published: Published | None = None,
    correct: "Correct | None" = None,
) -> PositioningReport:
    """Evaluate all tests in a recorded run.

    Args:
        recorded: the run.
        description: what is known of the measuring conditions.
        published: figures to compare with.
        correct: returns lines corrected, and in words how; None to leave them as they are.

    Raises:
        ValueError: no line of it is complete, or runs of one setup have different targets.
    """
    known = description or UncertaintyDescription()
    measured = recorded.measurement
    measurement, corrected = (measured, ()) if correct is None else correct(measured)
    runs = all_runs(measurement)
    if not runs:
        raise ValueError(
            f"{recorded.path}: no line of it is complete, so there is nothing to evaluate"
        )
    last = {(test.setup, test.kind, test.name): test for test in recorded.tests}
    return PositioningReport(
        tests=tuple(evaluate(one, known) for one in runs),
        source=str(recorded.path),
        run_id=recorded.run_id,
        unknown=known.unknown(),
        published=published,
        equals_recorded={
            one.setup: same_test(evaluate(one), last[key])
            for one in runs
            if (key := (one.setup, one.kind, one.name)) in last and not corrected
        },
        corrected=corrected,
    )


def same_test(first: PositioningTest, second: PositioningTest) -> bool:
    """Say whether two evaluations are the same in every bit of every number.

    Remarks are not compared: later versions may word them differently.
    """

    def numbers(test: PositioningTest) -> bytes:
        columns = (
            test.target,
            test.mean_forward,
            test.mean_backward,
            test.deviation_forward,
            test.deviation_backward,
            list(test.parameters.values()),
            list(test.expanded_uncertainty.values()),
        )
        # There are many bit patterns of NaN; all mean unknown.
        arrays = (np.asarray(column, dtype=np.float64) for column in columns)
        return b"".join(np.where(np.isnan(array), np.nan, array).tobytes() for array in arrays)

    def words(test: PositioningTest) -> tuple[object, ...]:
        return test.name, test.kind, test.setup, test.runs, list(test.parameters)

    return words(first) == words(second) and numbers(first) == numbers(second)
