"""How large the flat mirror must be: how far a step diagonal moves it sideways through the beam."""

from itertools import combinations

import numpy as np

from stepdiag_ros.metrology.geometry import beam_direction
from stepdiag_ros.metrology.plan import Plan


def mirror_width(plan: Plan) -> float:
    """Return how far the beam wanders over the mirror on one line, m; 0 on straight lines.

    The mirror must be so much wider than the beam. Moves are straight, so the largest way is
    between two stops; a block repeats the one before.
    """
    step = np.asarray(plan.volume.step)
    widest = 0.0
    for line in plan.lines:
        if not line.order:
            continue
        direction = beam_direction(line.name, step)
        block = line.stops(plan.volume)[: len(line.order) + 1]
        sideways = block - np.outer(block @ direction, direction)
        ways = (float(np.linalg.norm(a - b)) for a, b in combinations(sideways, 2))
        widest = max(widest, *ways)
    return widest
