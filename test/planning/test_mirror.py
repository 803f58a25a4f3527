"""The mirror that a plan needs, by the geometry of one block."""

from math import sqrt

import pytest

from stepdiag_ros.configuration import plan_from_text
from stepdiag_ros.planning.mirror import mirror_width

PLAN = """\
name: p
step_m: {step}
blocks: 4
repeats: 1
feed_m_per_s: 0.05
lines: {lines}
"""


def width(step, lines):
    return mirror_width(plan_from_text(PLAN.format(step=step, lines=lines), "plan"))


@pytest.mark.parametrize("name", ["ppp", "npp", "pnp", "ppn"])
@pytest.mark.parametrize("order", ["XYZ", "ZXY"])
def test_in_a_cube_the_mirror_goes_around_a_triangle(name, order):
    """Its corners are 0, and the first and the second move across the diagonal: sqrt(2/3) s."""
    lines = f"[{{kind: step_diagonal, names: [{name}], orders: [{order}]}}]"
    assert width([0.01, 0.01, 0.01], lines) == pytest.approx(0.01 * sqrt(2.0 / 3.0))


def test_a_flat_block_is_written_out():
    # Along (2, 1, 2)/3: after 20 mm of X and 10 mm of Y the mirror is farthest from where it was.
    lines = "[{kind: step_diagonal, names: [ppp], orders: [XYZ]}]"
    ends = [(0, 0, 0), (20, 0, 0), (20, 10, 0)]
    across = []
    for x, y, z in ends:
        along = (2 * x + y + 2 * z) / 3
        across.append((x - 2 * along / 3, y - along / 3, z - 2 * along / 3))
    ways = [
        sqrt(sum((a - b) ** 2 for a, b in zip(one, other, strict=True)))
        for one in across
        for other in across
    ]
    assert width([0.02, 0.01, 0.02], lines) == pytest.approx(1e-3 * max(ways))


def test_straight_lines_need_no_wider_mirror():
    lines = "[{kind: linear, names: [x, y]}, {kind: diagonal, names: [npp]}]"
    assert width([0.01, 0.01, 0.01], lines) == 0.0
