"""What drives each effect of the class *outside*: what moves, and on which quantities it depends.

Told from the physics of each kind alone, in the generator's own words:

==================  ============================================================================
word                quantity
==================  ============================================================================
``place X``         place of an axis
``sense X``         sense of its last move
``reversal X``      time since it turned round
``time``            time since the run began
``period``          time, to and fro
``material``        material temperature; ``air`` likewise
``path``            length of the beam's path up to the mirror
``line``            which line is measured: where the beam runs
==================  ============================================================================
"""

from dataclasses import asdict, dataclass

import numpy as np

READING = "reading"


@dataclass(frozen=True)
class Drivers:
    """What a right description says.

    Attributes:
        acts_on: X, Y, Z of the tool's displacement, or ``reading``.
        quantities: on all of which it depends, and on nothing else.
        lasting: it acts alike whenever the state is the same. What does not is random, or belongs
            to one alignment; what it did in a run is a function of nothing but time.
        in_box: it is a displacement of the tool at every place of the measured box.
    """

    acts_on: tuple
    quantities: tuple
    lasting: bool = True
    in_box: bool = True


def _places(*axes):
    return tuple(f"place {axis}" for axis in sorted(axes))


def arms_of(error, chain):
    """Axes along which a rotation moves the tool → the axis whose way is the arm of that."""
    about, axis = "XYZ"["ABC".index(error[2])], error[3]
    later = chain[chain.index(axis) + 1 :]
    first, second = (one for one in "XYZ" if one != about)
    return {moved: arm for moved, arm in ((first, second), (second, first)) if arm in later}


def _turn(error, chain):
    """A rotation moves the tool across the arms that later axes make; the mirror turns too."""
    arms = arms_of(error, chain)
    # No arm, no displacement: what is left is the mirror's turn, which the beam sees beside it.
    acts_on = tuple(sorted(arms)) or (READING,)
    return Drivers(
        acts_on,
        (*_places(*{error[3], *arms.values()}), "material"),
        in_box=False,
    )


def drivers_of(hidden, run):
    """Return what drives a hidden effect of the class *outside* in a run."""
    where = hidden.setting
    axis, other = where.get("axis", ""), where.get("other", "")
    component = (where.get("component") or where.get("direction") or "").upper()
    third = next((one for one in "XYZ" if one not in (axis, other)), "")
    told = {
        "cubic_sag": lambda: Drivers((component,), _places(*"XYZ")),
        "bent_sag": lambda: Drivers((component,), _places(axis, other)),
        "thermal_turn": lambda: _turn(where["error"], run.plan.chain),
        "chiller": lambda: Drivers((component,), ("period",)),
        "random_walk": lambda: Drivers((READING,), ("time",), lasting=False, in_box=False),
        "cross_talk": lambda: Drivers((axis,), (*_places(other), f"sense {axis}")),
        "stick_slip": lambda: Drivers((axis,), ("time",), lasting=False),
        "worn_spot": lambda: Drivers((third,), _places(axis, other)),
        "quadrant_bend": lambda: Drivers((component,), _places(axis, other)),
        "creep": lambda: Drivers((axis,), (f"reversal {axis}", f"sense {axis}")),
        "load_hysteresis": lambda: Drivers((component,), (*_places(other), f"sense {axis}")),
        "vibration": lambda: Drivers((component,), _places(axis, other)),
        "warm_spot": lambda: Drivers((READING,), ("path", "line"), in_box=False),
        "interpolation": lambda: Drivers((axis,), _places(axis, other)),
        "loose_mirror": lambda: Drivers((READING,), ("time",), lasting=False, in_box=False),
    }
    return told[hidden.kind]()


def facts_of(hidden, run):
    """Return what is sealed of a hidden effect: its drivers, and what the run makes one.

    ``one_temperature``: the run's table has the same numbers for air and material.
    ``jumps``: where a mirror jumped and jumped back: direction, repeat and stop of each.
    """
    jumps = []
    if hidden.kind == "loose_mirror":
        here = np.flatnonzero(run.setup == hidden.setting["setup"])
        for moment in (hidden.setting["begin"], hidden.setting["end"]):
            row = run.rows[here[np.searchsorted(run.time[here], moment)]]
            jumps.append({"repeat": row[3], "direction": row[4], "stop": row[5]})
    return {
        "drivers": asdict(drivers_of(hidden, run)),
        "one_temperature": bool(np.allclose(run.air, run.material)),
        "jumps": jumps,
    }
