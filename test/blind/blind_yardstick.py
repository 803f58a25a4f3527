"""How much of an effect a plan can show at all, by the generator's own linear algebra.

An effect's signature is what is left of it after everything that the run leaves free: curves of the
axes at every node, two tilts of each diagonal setup, and a zero of each setup. The tests need it to
scale effects that no workflow states a limit for, to leave out what nobody can see, and to find
pairs that nobody can tell apart.
"""

import numpy as np

SEEN = 7.0
"""Standard deviations of its amplitude at which an effect outside a catalogue counts as at its
detection limit: well above what the largest of thousands of candidates reaches by chance (4-5)."""


def free_columns(run):
    """Columns of the harmless part, (n, parameters)."""
    nodes = run.plan.blocks + 1
    columns = []
    for axis in range(3):
        index = np.rint(run.position[:, axis] / run.plan.step[axis]).astype(int)
        here = np.eye(nodes)[index][:, 1:]
        columns.extend(here * run.beam[:, [component]] for component in range(3))
    for number, setup in enumerate(run.plan.setups):
        chosen = (run.setup == number).astype(float)[:, None]
        columns.append(chosen)
        if setup.kind != "linear":
            beam = run.beam[run.setup == number][0]
            across = np.linalg.svd(beam[None, :])[2][1:]
            columns.append(chosen * ((run.position - run.start) @ across.T))
    return np.hstack(columns)


class Yardstick:
    """Projects signatures on what a run leaves over."""

    def __init__(self, run):
        left, sizes, _ = np.linalg.svd(free_columns(run), full_matrices=False)
        self.basis = left[:, sizes > 1e-9 * sizes[0]]
        self.freedom = len(run.time) - self.basis.shape[1]

    def signature(self, change):
        """The part of a change of the readings that the free parameters cannot take over."""
        return change - self.basis @ (self.basis.T @ change)

    def visible(self, change):
        """Part of a change that is seen, 0..1."""
        whole = np.linalg.norm(change - change.mean())
        return float(np.linalg.norm(self.signature(change)) / whole) if whole else 0.0

    def alike(self, one, other):
        """|cosine| between the signatures of two changes, 0..1."""
        first, second = self.signature(one), self.signature(other)
        norms = np.linalg.norm(first) * np.linalg.norm(second)
        return float(abs(first @ second) / norms) if norms else 0.0
