"""What of a run is in the picture, live or from a bag, and what is to be drawn again."""

from dataclasses import dataclass
from enum import Enum, auto

from stepdiag_ros.metrology.frames import (
    Placement,
    Triple,
    setup_placements,
    tool_placement,
    workpiece_placement,
)
from stepdiag_ros.metrology.measurement import MeasuredLine
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.metrology.solvers.result import VolumetricErrors
from stepdiag_ros.viewers.scene.error_markers import Options, chosen_results, picture
from stepdiag_ros.viewers.scene.progress_markers import DrawnProgress, progress_markers
from stepdiag_ros.viewers.scene.shapes import Shape


class Part(Enum):
    """A part of the picture that is drawn by itself."""

    TOOL = auto()
    """Where the tool is."""
    SETUP = auto()
    """Where the workpiece, the laser and the mirror are."""
    PROGRESS = auto()
    """The lines, what is measured of them, and the beam."""
    ERRORS = auto()
    """What was found."""


@dataclass(frozen=True)
class View:
    """How a run is shown.

    Attributes:
        laser_distance: from the laser to the mirror at the first stop of a line, m.
        mirror_offset: from the tool to the mirror, m, in machine axes.
        method: whose results; see ``chosen_results``.
        exaggeration: of the errors; see ``Options``.
    """

    laser_distance: float = DrawnProgress.laser_distance
    mirror_offset: Triple = DrawnProgress.mirror_offset
    method: str = "preferred"
    exaggeration: float = Options.exaggeration


class RunPicture:
    """Follows a run.

    The tool is known before any run is; all else belongs to the run that was begun last.
    """

    def __init__(self) -> None:
        self._plan: Plan | None = None
        self._chain = ""
        self._results: dict[str, VolumetricErrors] = {}
        self._measured: dict[int, bool] = {}
        self._line_index = 0
        self._present: int | None = None
        self._position: Triple | None = None
        self._changed: set[Part] = set()

    def begin(self, plan: Plan, chain: str) -> None:
        """Begin a new picture: the box and the lines of the plan, and the first setup.

        Args:
            plan: of the run.
            chain: kinematic chain of its machine, for example ``YXZ``; empty if it is not known.
        """
        self._plan, self._chain = plan, chain
        self._results, self._measured = {}, {}
        self._line_index, self._present = 0, None
        self.redraw(Part.SETUP, Part.PROGRESS, Part.ERRORS)

    def take_position(self, position: Triple) -> None:
        """Show the tool at the actual position of the axes, m."""
        self._position = position
        self.redraw(Part.TOOL, Part.PROGRESS)

    def take_line(self, line: MeasuredLine) -> None:
        """Show a line as measured."""
        self._measured[line.line_index] = line.complete
        self.redraw(Part.PROGRESS)

    def take_result(self, result: VolumetricErrors) -> None:
        """Show a result, in place of the one of its method before."""
        self._results[result.method] = result
        self.redraw(Part.ERRORS)

    def take_present(self, present: int | None) -> None:
        """Show which pass of the plan is measured, with laser and mirror set up for it.

        Args:
            present: number of the pass; None once the run is over, and the setup stays.
        """
        unknown = self._plan is None or (present or 0) >= len(self._plan.lines)
        if unknown or present == self._present:
            return
        self._present = present
        if present is not None:
            self._line_index = present
        self.redraw(Part.SETUP, Part.PROGRESS)

    def redraw(self, *parts: Part) -> None:
        """Draw parts again at the next look."""
        self._changed.update(parts)

    # Each is given once after a change; None: nothing is to be drawn again, or nothing is known
    # yet.

    def tool(self) -> tuple[Placement, ...] | None:
        """Return the frame of the tool."""
        if self._position is None or not self._is_due(Part.TOOL):
            return None
        return (tool_placement(self._position),)

    def setup(self, view: View) -> tuple[Placement, ...] | None:
        """Return the frames of workpiece, laser and mirror."""
        if self._plan is None or not self._is_due(Part.SETUP):
            return None
        volume, line = self._plan.volume, self._plan.lines[self._line_index]
        setup = setup_placements(line, volume, view.laser_distance, view.mirror_offset)
        return (workpiece_placement(volume), *setup)

    def progress(self, view: View) -> tuple[Shape, ...] | None:
        """Return the lines and the beam."""
        if self._plan is None or not self._is_due(Part.PROGRESS):
            return None
        progress = DrawnProgress(
            self._measured, self._present, self._position, view.laser_distance, view.mirror_offset
        )
        return progress_markers(self._plan, progress)

    def errors(self, view: View) -> tuple[Shape, ...] | None:
        """Return the box and what was found in it."""
        if self._plan is None or not self._is_due(Part.ERRORS):
            return None
        chosen = chosen_results(self._results, view.method)
        return picture(chosen, self._plan, Options(view.exaggeration, self._chain))

    def _is_due(self, part: Part) -> bool:
        due = part in self._changed
        self._changed.discard(part)
        return due
