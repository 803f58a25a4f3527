"""What a plan will not determine, and which further line would: found by trying, not by rule."""

from dataclasses import dataclass, replace

from stepdiag_ros.metrology.geometry import AXES, BODY_DIAGONALS, ROTATIONS
from stepdiag_ros.metrology.plan import (
    BACKWARD,
    DIAGONAL,
    FORWARD,
    LINEAR,
    STEP_DIAGONAL,
    Line,
    Plan,
    axes_at_hand,
)
from stepdiag_ros.metrology.visibility import DETERMINED, Visibility, visibility
from stepdiag_ros.planning.candidates import EDGE_LINES, THREE_ORDERS, Group, Scheme, lines_of
from stepdiag_ros.planning.moves import passes_of

_BLOCKS_TO_TRY = 8
_SAME_PLACE = 1e-6


@dataclass(frozen=True)
class Remedy:
    """An addition with which a plan determines more.

    Attributes:
        words: what is added.
        shows: names of the errors that become determined.
    """

    words: str
    shows: tuple[str, ...]


def remedies(plan: Plan, chain: str, stop_uncertainty: float, seen: Visibility) -> list[Remedy]:
    """Return what would show angular errors that a plan does not determine.

    Each addition is tried by itself: three move orders in one alignment on every step diagonal, and
    each linear line at the far end of another axis; then all of them together. They are tried on a
    grid of a few blocks over the same box: what the lines distinguish does not depend
    on how often they stop.

    Args:
        plan: as it is.
        chain: of the machine.
        stop_uncertainty: of a stop, m.
        seen: the visibility of the plan with this chain.
    """
    hidden = {row.name for row in seen.rows if row.name in ROTATIONS and row.status != DETERMINED}
    if not hidden:
        return []
    plan = coarse(plan)
    additions = [*_with_orders(plan), *_with_edge_lines(plan)]
    together: Plan | None = None
    if len(additions) > 1:
        both = plan
        for _, changed in additions:
            extra = tuple(line for line in changed.lines if line not in both.lines)
            both = replace(
                both,
                lines=both.lines + extra,
                one_alignment_per_diagonal=both.one_alignment_per_diagonal
                or changed.one_alignment_per_diagonal,
            )
        together = both
        words = "all linear lines at other edges of the box"
        if together.one_alignment_per_diagonal:
            words += " and the move orders in one alignment"
        additions.append((words, together))
    found: list[Remedy] = []
    for words, changed in additions:
        table = visibility(changed, chain, stop_uncertainty)
        shown = tuple(
            name for name in ROTATIONS if name in hidden and table.row(name).status == DETERMINED
        )
        already = {name for remedy in found for name in remedy.shows}
        # All together are worth a word only if they show what none shows alone.
        if shown and not (changed is together and already >= set(shown)):
            found.append(Remedy(words, shown))
    return found


def limits(
    plan: Plan,
    chain: str,
    stop_uncertainty: float,
    seen: Visibility,
    rotating: Visibility | None,
) -> list[str]:
    """State in sentences what a plan does not determine.

    Args:
        plan: as it is.
        chain: of the machine; empty if not known.
        stop_uncertainty: of a stop, m.
        seen: the visibility of the plan without rotations.
        rotating: that with all rotations free; None without a chain.
    """
    if rotating is None:
        sentences = [
            "The kinematic chain is not known: angular errors are taken as zero, and what they do "
            "is put down to the other errors."
        ]
    else:
        sentences = _angular_sentences(plan, chain, stop_uncertainty, seen, rotating)
    if not any(line.direction == BACKWARD for line in plan.lines):
        sentences.append(
            "Every line is run in one direction only: reversal errors do not show, and drift is"
            " not distinguished from the errors."
        )
    elif any(line.kind == LINEAR and plan.run_up(line) is None for line in plan.lines):
        sentences.append(
            "Linear lines begin without a run-up, so that the first stop of a pass is not"
            " approached in its direction: end stops show no reversal error. --overrun 0.002 (in a"
            " plan, overrun_m) adds one of 2 mm."
        )
    counts = _repeats(plan)
    if max(counts) < 2:
        each = " in each direction" if any(one.direction == BACKWARD for one in plan.lines) else ""
        sentences.append(
            f"Each line is run once{each}: repeatability does not follow. --repeats 2 (in a"
            " plan, repeats) runs each twice."
        )
    elif min(counts) < 2:
        sentences.append(
            "Some lines are run only once in a direction: their repeatability does not follow."
        )
    if not any(line.kind == LINEAR for line in plan.lines):
        sentences.append(
            "No linear axis is measured by itself: no reading shows an axis's positioning alone."
        )
    if any(line.kind == DIAGONAL for line in plan.lines):
        sentences.append(
            "Diagonals alone do not determine volumetric accuracy: errors that cancel along a"
            " diagonal do not show."
        )
    sentences.append(
        "No expected uncertainty contains the wavelength in air beyond what good sensors leave, the"
        " expansion of the machine or the dead path, which are common to all stops; without a "
        "weather station 1 K of the air is about 1 µm/m of every length. Those by noise alone do"
        " not contain undetermined rotations either, which are mostly the largest part."
    )
    return sentences


def warnings(plan: Plan) -> list[str]:
    """Say in sentences what is unwise in a plan that somebody wrote."""
    found: list[str] = []
    aligned: dict[str, int] = {}
    for one in passes_of(plan):
        aligned[one.setup] = aligned.get(one.setup, 0) + one.new_setup
    twice = [name for name, count in aligned.items() if count > 1]
    if twice and plan.pause_for_setup:
        found.append(
            f"{', '.join(twice)}: aligned more than once, with other lines between, but solved as "
            "one alignment with one zero; put the lines of a setup next to one another."
        )
    orders = {line.order for line in plan.lines if line.kind == STEP_DIAGONAL}
    if len(orders) > 1 and not plan.one_alignment_per_diagonal:
        found.append(
            "The move orders are aligned one by one; with one_alignment_per_diagonal the plan"
            " determines more of the angular errors and takes fewer alignments."
        )
    sampling = plan.sampling
    if sampling.dwell < sampling.settle + sampling.window:
        found.append(
            f"dwell_s {sampling.dwell:g} is shorter than settle_s + window_s "
            f"{sampling.settle + sampling.window:g}, which a stop takes in any case."
        )
    return found


def _angular_sentences(
    plan: Plan, chain: str, stop_uncertainty: float, seen: Visibility, rotating: Visibility
) -> list[str]:
    status = {row.name: row.status for row in rotating.rows}
    hidden = [name for name in ROTATIONS if status[name] != DETERMINED]
    if not hidden:
        return []
    found = remedies(plan, chain, stop_uncertainty, rotating)
    sentences = [
        f"{', '.join(remedy.shows)}: not determined; {remedy.words} would determine"
        f" {'it' if len(remedy.shows) == 1 else 'them'}."
        for remedy in found
    ]
    never = [name for name in hidden if not any(name in remedy.shows for remedy in found)]
    if never:
        sentences.append(
            f"{', '.join(never)}: not determined, and no linear line or move order added to this"
            " plan would do it; other diagonals, an angular interferometer, a level or another"
            " mirror offset can."
        )
    leaning = [
        row.name for row in seen.rows if row.status == DETERMINED and status[row.name] != DETERMINED
    ]
    if leaning:
        sentences.append(
            f"{', '.join(leaning)}: right only if the angular errors that are not determined are"
            " small; methods without rotations take them as zero."
        )
    return sentences


def _with_orders(plan: Plan) -> list[tuple[str, Plan]]:
    """Return the plan with three move orders in one alignment, if it has step diagonals."""
    steps = [
        line for line in plan.lines if line.kind == STEP_DIAGONAL and line.name in BODY_DIAGONALS
    ]
    orders = {line.order for line in steps}
    if not steps or (orders >= set(THREE_ORDERS) and plan.one_alignment_per_diagonal):
        return []
    group = Group(STEP_DIAGONAL, tuple(dict.fromkeys(line.name for line in steps)), THREE_ORDERS)
    added = tuple(line for line in single(group, plan) if line not in steps)
    words = f"the move orders {', '.join(THREE_ORDERS)} of every step diagonal in one alignment"
    return [(words, replace(plan, lines=plan.lines + added, one_alignment_per_diagonal=True))]


def _with_edge_lines(plan: Plan) -> list[tuple[str, Plan]]:
    """Return the plan with each linear line at another edge of the box that it has not."""
    made = []
    axes = axes_at_hand(plan.lines)
    for group in EDGE_LINES:
        added = single(group, plan)
        needed = {group.names[0].upper()}
        needed |= {
            letter for line in added for letter, way in zip(AXES, line.offset, strict=True) if way
        }
        if not needed <= set(axes):
            continue
        if not any(line.setup == one.setup for line in plan.lines for one in added):
            place = added[0].setup.partition("@")[2]
            words = f"a linear line {group.names[0]} shifted by {place} m"
            made.append((words, replace(plan, lines=plan.lines + added)))
    return made


def coarse(plan: Plan, blocks: int = _BLOCKS_TO_TRY) -> Plan:
    """Return the plan with fewer blocks over the same box, if no line stands between the nodes.

    Args:
        plan: as it is.
        blocks: that are left, at most.
    """
    volume = plan.volume
    whole = tuple(step * volume.blocks for step in volume.step)
    at_ends = all(
        abs(shift) < _SAME_PLACE or abs(shift - side) < _SAME_PLACE
        for line in plan.lines
        for shift, side in zip(line.offset, whole, strict=True)
    )
    if volume.blocks <= blocks or not at_ends:
        return plan
    x, y, z = (side / blocks for side in whole)
    return replace(plan, volume=replace(volume, step=(x, y, z), blocks=blocks))


def single(group: Group, plan: Plan) -> tuple[Line, ...]:
    """Return the lines of a group over a plan's box, each once and forward."""
    return lines_of(Scheme("", (group,)), plan.volume, 1, (FORWARD,))


def _repeats(plan: Plan) -> list[int]:
    """Return how often each pass is run the same way."""
    count: dict[tuple[str, str, str], int] = {}
    for line in plan.lines:
        key = (plan.setup_of(line), line.order, line.direction)
        count[key] = count.get(key, 0) + 1
    return list(count.values())
