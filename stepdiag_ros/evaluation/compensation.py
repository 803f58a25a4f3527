"""From a solved run to what is compensated, and from that to tables and what these leave."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timezone

import numpy as np

from stepdiag_ros.bags.digest import sha256_of
from stepdiag_ros.compensation.applied import Applied, Beyond
from stepdiag_ros.compensation.control import Control, Files, Layout, checked_files
from stepdiag_ros.compensation.identified import Identified, Origin, identify
from stepdiag_ros.compensation.remaining import Remainder, remainder
from stepdiag_ros.evaluation.report import Report
from stepdiag_ros.evaluation.solving import one_thread
from stepdiag_ros.metrology.discrepancy.extension import with_chain, without_effects
from stepdiag_ros.metrology.effects.effect import ActiveEffect
from stepdiag_ros.metrology.effects.learned_shape import Learned as LearnedEffect
from stepdiag_ros.metrology.effects.learned_shape import without_domain
from stepdiag_ros.metrology.learned_displacement import depends_on, displacements, is_geometric
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.model import MachineModel, ModelEffect
from stepdiag_ros.metrology.solvers.catalogue import require_to_rely_on
from stepdiag_ros.metrology.units import IN_MICRO

ANY_DATE = 1e8
"""s since 1970: no run that was recorded is older."""


@dataclass(frozen=True)
class CompensationReport:
    """Tables and what they leave.

    Attributes:
        control: that they are for.
        identified: errors that they were made from.
        layout: how they were made.
        files: name → text.
        remainder: what they leave.
        on_top_of: folder of the tables that are contained in them; empty: none.
    """

    control: Control
    identified: Identified
    layout: Layout
    files: Files
    remainder: Remainder
    on_top_of: str = ""


@dataclass(frozen=True)
class Learned:
    """What compensation takes from a model of the machine: its geometric learned effects.

    Attributes:
        model: of the machine.
        source: the model in words, for sentences.
    """

    model: MachineModel
    source: str

    @property
    def effects(self) -> tuple[ModelEffect, ...]:
        """Return the learned displacements by places alone."""
        return tuple(effect for effect in self.model.effects if is_geometric(effect))

    def warnings(self) -> list[str]:
        """Say which learned effects are not compensated, and where a domain is not known."""
        others = [
            f"'{one.label}' is not compensated: it acts on {one.active.setting['acts_on']} and"
            f" depends on {' and '.join(depends_on(one))}, and only displacements along X, Y or Z"
            " by places alone are."
            for one in self.model.effects
            if isinstance(one.active.effect, LearnedEffect) and not is_geometric(one)
        ]
        return [*others, *without_domain(one.active for one in self.effects)]

    def taken_off(self, measurement: Measurement) -> tuple[Measurement, tuple[str, ...]]:
        """Return lines without the learned displacements, and in words what was done.

        Raises:
            ValueError: the run is of another machine than the model, or reaches beyond the domain
                in which an effect was learned.
        """
        known = with_chain(measurement, self.model)
        nodes = known.volume.all_nodes
        low, high = (np.array([axis[end] for axis in nodes]) for end in (0, -1))
        displacements(self.effects, low, high)
        active: list[ActiveEffect] = [one.active for one in self.effects]
        words = tuple(
            f"{one.label} ({one.active.sizes['amplitude'] * IN_MICRO:.3f} µm) is taken from"
            f" {self.source}, off the lines before they were solved, and beside the curves"
            for one in self.effects
        )
        return without_effects(known, active), words


def identified_of(
    report: Report,
    start_time: int,
    method: str = "",
    sha256: str | None = None,
    learned: Sequence[ModelEffect] = (),
) -> Identified:
    """Return the errors that a solved run has determined, with their origin.

    Args:
        report: of the run, with its bag.
        start_time: of the run, ns.
        method: of the solver; empty: the one to rely on.
        sha256: of the bag, where it was computed already.
        learned: displacements that were taken off the lines before they were solved.

    Raises:
        ValueError: no method could be used, or not this one, or the result is not enough for an
            error map; one sentence.
    """
    path = report.bag
    results = {one.method: one for one in report.ordered_results()}
    if not results:
        raise ValueError(f"{path}: the lines are not enough for any method; see 'stepdiag solve'")
    if method and method not in results:
        reason = report.refused.get(method, f"there is no such method; use {', '.join(results)}")
        raise ValueError(f"{path}: method '{method}': {reason}")
    result = results[method or require_to_rely_on(results, str(path))]
    start = start_time * 1e-9
    # A table of stops tells no date; its times count from zero.
    begun = datetime.fromtimestamp(start, timezone.utc) if start > ANY_DATE else None
    if sha256 is None:
        sha256 = sha256_of(path) if path is not None and path.is_file() else ""
    origin = Origin(
        file="" if path is None else path.name,
        sha256=sha256,
        run_id=report.run_id,
        run_time="" if begun is None else begun.isoformat(timespec="seconds"),
        plan=report.plan,
        machine=report.machine,
        method=result.method,
        software_version=report.run_software_version,
    )
    with one_thread():
        return identify(
            *(result, report.chain, report.measurement, origin, report.remarks),
            verdict=report.verdict,
            passes=report.passes,
            learned=learned,
        )


def compensation_of(
    control: Control, identified: Identified, layout: Layout, on_top_of: str = ""
) -> CompensationReport:
    """Make the tables of a control, and find what they leave.

    Args:
        control: that they are for.
        identified: errors that they are made from.
        layout: how they are made.
        on_top_of: folder of the tables in the layout that were at work when the run was measured;
            empty: none.

    Raises:
        ValueError: a setting or a limit of the control forbids it; one sentence.
    """
    files = checked_files(control, identified, layout)
    applied: Applied = control.read(files)
    if layout.on_top_of.tables:
        applied = Beyond(applied, layout.on_top_of)
    return CompensationReport(
        control=control,
        identified=identified,
        layout=layout,
        files=files,
        remainder=remainder(identified, applied, control.corrects),
        on_top_of=on_top_of,
    )
