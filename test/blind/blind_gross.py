"""Gross errors: a run under wrong names, signs, units, or with rows lost and doubled.

They are made as they happen. What is done to the machine or the laser changes the readings,
computed exactly; what is done to the table changes its rows.
"""

from dataclasses import replace

import numpy as np
from blind_kinematics import Action
from blind_plans import DIAGONALS, ORDERS, make_run
from blind_tables import table_rows, written

OF_THE_MACHINE = ("reversed_axis", "swapped_axes", "wrong_line", "wrong_order")
OF_THE_LASER = ("sign", "millimetres", "inches", "half", "turned_pass", "outlier")
OF_THE_TABLE = ("repeated_row", "lost_row", "positions_in_mm", "renamed_rows")
GROSS = (*OF_THE_MACHINE, *OF_THE_LASER, *OF_THE_TABLE)
FACTORS = {"sign": -1.0, "millimetres": 1e3, "inches": 1.0 / 0.0254, "half": 0.5}
OUTLIER = 30e-6
"""Of a wrong digit: too small to be seen in a table, far above any noise, m."""


def draw_gross(rng, plan):
    """Draw a gross error and where it is: a mapping of its kind and what belongs to it.

    ``route`` says how the run comes to the workflow: as a ``table``, which is checked as it is
    read, or ``measured`` live, where there is no table.
    """
    kind = str(rng.choice(GROSS))
    diagonals = [n for n, setup in enumerate(plan.setups) if setup.kind == "step_diagonal"]
    setup = int(rng.choice(diagonals))
    named = plan.setups[setup]
    axis, other = (str(letter) for letter in rng.permutation(list("XYZ"))[:2])
    lines = [line for line in DIAGONALS if line != named.line]
    orders = [order for order in ORDERS if order != named.order]
    further = {
        "reversed_axis": {"axis": axis},
        "swapped_axes": {"axis": axis, "other": other},
        "wrong_line": {"setup": setup, "line": str(rng.choice(lines))},
        "wrong_order": {"setup": setup, "order": str(rng.choice(orders))},
        "renamed_rows": {"setup": setup, "line": str(rng.choice(lines))},
        "turned_pass": {"setup": setup},
        "outlier": {"setup": setup, "stop": int(rng.integers(2, 3 * plan.blocks - 1))},
        "repeated_row": {"setup": setup, "stop": int(rng.integers(2, 3 * plan.blocks - 1))},
        "lost_row": {"setup": setup, "stop": int(rng.integers(2, 3 * plan.blocks - 1))},
    }
    route = "table" if kind in OF_THE_TABLE else str(rng.choice(["table", "measured"]))
    return {"kind": kind, "route": route, **further.get(kind, {})}


def gross_table(machine, gross, rng):
    """Text of the table with a gross error, and of the table as it was nominally to be, or None."""
    run = machine.run()
    kind = gross["kind"]
    if kind in OF_THE_TABLE:
        readings = machine.measured(run, Action.none(len(run.time)), rng)
        return written(_of_table(table_rows(run, readings), run, gross)), None
    readings = _of_machine(machine, run, gross, rng)
    if kind in FACTORS:
        readings = readings * FACTORS[kind]
    if kind == "turned_pass":
        here = run.passes == run.passes[run.setup == gross["setup"]][0]
        readings[here] = readings[here][::-1] - readings[here][-1]
    if kind == "outlier":
        place = np.flatnonzero(run.setup == gross["setup"])[gross["stop"]]
        readings[place] += OUTLIER
    return written(table_rows(run, readings)), written(table_rows(run, run.along))


def _of_machine(machine, run, gross, rng):
    """Readings of what the machine really did under the names of a run."""
    done = run
    if gross["kind"] == "reversed_axis":
        done = _moved(run, lambda place: _mirrored(place, "XYZ".index(gross["axis"]), run.travel))
    elif gross["kind"] == "swapped_axes":
        one, two = "XYZ".index(gross["axis"]), "XYZ".index(gross["other"])
        order = [{one: two, two: one}.get(axis, axis) for axis in range(3)]
        done = _moved(run, lambda place: place[:, order])
    elif gross["kind"] in ("wrong_line", "wrong_order"):
        changed = {name: gross[name] for name in ("line", "order") if name in gross}
        setups = list(machine.plan.setups)
        setups[gross["setup"]] = replace(setups[gross["setup"]], **changed)
        done = make_run(replace(machine.plan, setups=tuple(setups)), machine.approach)
    return machine.measured(done, Action.none(len(run.time)), rng)


def _moved(run, change):
    return replace(run, position=change(run.position), start=change(run.start))


def _mirrored(place, axis, travel):
    mirrored = place.copy()
    mirrored[:, axis] = travel[axis] - place[:, axis]
    return mirrored


def _of_table(rows, run, gross):
    """Rows of a table that was spoilt."""
    kind = gross["kind"]
    if kind == "positions_in_mm":
        for row in rows:
            row[7:10] = [f"{float(value) * 1e3:.3f}" for value in row[7:10]]
        return rows
    places = np.flatnonzero(run.setup == gross["setup"])
    if kind == "renamed_rows":
        for place in places:
            rows[place][2] = gross["line"]
        return rows
    place = int(places[gross["stop"]])
    if kind == "repeated_row":
        return rows[: place + 1] + rows[place:]
    return rows[:place] + rows[place + 1 :]
