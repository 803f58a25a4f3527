"""Make the solvers' reference problems and certify their answers.

Run as ``python test/reference/certify_solvers.py`` (some minutes); writes
``test/data/reference/solver_*.json``. The answers are those of the readings in the file, taken as
the doubles they are, in 50 digits, of which 25 are written.
"""

import json
import sys
from pathlib import Path

from adjustment import Adjustment
from exact import digits, exactly, line_through
from formulations import (
    alternative,
    conventional,
    curves_of,
    displacements,
    setup_robust,
    uncertainties,
)
from mpmath import mp, mpf
from posed import Problem, passes

TARGET = Path(__file__).parents[1] / "data" / "reference"
THREE = ("x", "y", "z", "ppp XYZ", "npp XYZ", "pnp XYZ")
FOUR = (*THREE, "ppn XYZ")
ORDERS = tuple(f"{line} {o}" for line in ("ppp", "npp", "pnp") for o in ("XYZ", "YZX", "ZXY"))
BOTH = ("forward", "backward")
SQUARENESS = {
    "C0Y": (-1, ("E_XY", "E_YX")),
    "B0Z": (1, ("E_XZ", "E_ZX")),
    "A0Z": (-1, ("E_YZ", "E_ZY")),
}
"""By right-handed rotation: turning Y by +C moves its far end to -X; Z by +B to +X; Z by +A to -Y.
"""


def problems():
    centimetre = (0.01, 0.01, 0.01)
    weights = {
        "x": 2e-8,
        "y": 1e-7,
        "z": 5e-8,
        "ppp XYZ": 1e-7,
        "npp XYZ": 1e-6,
        "pnp YZX": 3e-8,
        "ppn ZXY": 4e-7,
    }
    return [
        Problem(
            "paper_size",
            "12 blocks of 10 mm as in Ibaraki & Hata 2010, section 4; three diagonals",
            centimetre,
            12,
            (0.0, 0.0, 0.0),
            passes(THREE, 12),
            tilt=1.5e-4,
            size=2e-6,
            noise=1e-7,
            seed=1,
        ),
        Problem(
            "noise_free",
            "the same setup errors, four diagonals, readings without noise",
            centimetre,
            6,
            (0.0, 0.0, 0.0),
            passes(FOUR, 6),
            tilt=1.5e-4,
            size=2e-6,
            noise=0.0,
            seed=2,
        ),
        Problem(
            "unequal_steps",
            "steps 10, 25, 7 mm, forward and backward, two repeats, three move orders",
            (0.01, 0.025, 0.007),
            4,
            (0.1, -0.4, 0.05),
            passes(("x", "y", "z", *ORDERS), 4, repeats=2, directions=BOTH),
            tilt=2e-4,
            size=5e-6,
            noise=1e-7,
            seed=3,
        ),
        Problem(
            "badly_scaled",
            "steps 500, 20, 1 mm: diagonals almost along X",
            (0.5, 0.02, 0.001),
            4,
            (0.0, 0.0, 0.0),
            passes(FOUR, 4),
            tilt=1e-4,
            size=5e-6,
            noise=5e-8,
            seed=4,
        ),
        Problem(
            "long_axis",
            "X of 10 m beside 2 m and 1.6 m, far from the machine's zero",
            (2.5, 0.5, 0.4),
            4,
            (-5.0, 1.0, 0.3),
            passes(FOUR, 4, uncertainty=1e-6, directions=BOTH),
            tilt=5e-5,
            size=5e-5,
            noise=1e-6,
            seed=5,
        ),
        Problem(
            "nanometre",
            "errors of 1 nm, noise of 10 pm, at 3 m from the machine's zero",
            centimetre,
            5,
            (3.0, -3.0, 3.0),
            passes(FOUR, 5, uncertainty=1e-11),
            tilt=1e-5,
            size=1e-9,
            noise=1e-11,
            seed=6,
        ),
        Problem(
            "large_tilt",
            "setups tilted by 5 mrad: the second order is 2.5 µm over 200 mm",
            (0.02, 0.015, 0.025),
            5,
            (0.0, 0.0, 0.0),
            passes(FOUR, 5),
            tilt=5e-3,
            size=3e-6,
            noise=0.0,
            seed=7,
        ),
        Problem(
            "unequal_weights",
            "lines with uncertainties from 20 nm to 1 µm, both ways, two stops rejected",
            (0.03, 0.02, 0.01),
            3,
            (0.2, 0.1, 0.0),
            passes(tuple(weights), 3, uncertainty=weights, directions=BOTH),
            tilt=1e-4,
            size=4e-6,
            noise=1e-7,
            seed=8,
            missing=((6, 4), (11, 7)),
        ),
        Problem(
            "diagonals_alone",
            "four diagonals without linear lines: squareness and shapes, but no scale",
            (0.04, 0.03, 0.05),
            5,
            (0.0, 0.0, 0.0),
            passes(FOUR[3:], 5, directions=BOTH),
            tilt=1e-4,
            size=3e-6,
            noise=1e-7,
            seed=9,
        ),
        Problem(
            "unknown_noise",
            "readings without uncertainty, three repeats: the noise comes from the residuals",
            (0.02, 0.02, 0.03),
            3,
            (0.0, 0.0, 0.0),
            passes(FOUR, 3, uncertainty=None, repeats=3),
            tilt=1e-4,
            size=3e-6,
            noise=2e-7,
            seed=10,
        ),
        Problem(
            "one_block",
            "a single block: two nodes on every axis",
            (0.1, 0.2, 0.15),
            1,
            (0.0, 0.0, 0.0),
            passes(FOUR, 1, directions=BOTH),
            tilt=1e-4,
            size=3e-6,
            noise=1e-7,
            seed=11,
        ),
    ]


def figures(problem, curves):
    """Return squareness, positioning and straightness as IH Table 1 defines them."""
    nodes = [
        [exactly(o) + exactly(a) * k for k in range(problem.blocks + 1)]
        for o, a in zip(problem.origin, problem.step, strict=True)
    ]
    found = {}
    for name, (factor, pair) in SQUARENESS.items():
        found[name] = factor * mp.fsum(
            line_through(nodes["XYZ".index(curve[3])], curves[curve])[0] for curve in pair
        )
    for name, values in curves.items():
        if name[2] == name[3]:
            found[f"positioning {name}"] = values[-1]
            continue
        axis = nodes["XYZ".index(name[3])]
        slope, start = line_through(axis, values)
        left = [v - start - slope * node for v, node in zip(values, axis, strict=True)]
        found[f"straightness {name}"] = max(left) - min(left)
    return found


def certified(curves, found, uncertainty=None, **further):
    answer = {
        "curves": {name: [digits(v) for v in values] for name, values in curves.items()},
        "figures": {name: digits(value) for name, value in found.items()},
    }
    if uncertainty is not None:
        answer["standard_uncertainty"] = {
            name: [digits(v) for v in values] for name, values in uncertainty.items()
        }
    return {**answer, **further}


def by_formulations(problem):
    names = {line.name for line in problem.passes}
    if not {"x", "y", "z", "ppp", "npp", "pnp"} <= names:
        return {}
    known = all(line.uncertainty for line in problem.passes)
    answers = {}
    for name, method in (
        ("conventional", conventional),
        ("setup_robust", setup_robust),
        ("alternative", alternative),
    ):
        increments, setup = method(problem, displacements(problem))
        curves = curves_of(increments)
        own = uncertainties(problem, method) if known and name != "alternative" else None
        answers[name] = certified(curves, {**figures(problem, curves), **setup}, own)
    return answers


def by_adjustment(problem):
    """Solve by least squares; without linear lines, with each axis's scale held and not certified.

    Squareness and straightness do not depend on what is held then.
    """
    alone = not any(len(line.name) == 1 for line in problem.passes)
    held = [(f"E_{a}{a}", problem.blocks) for a in "XY"] if alone else []
    made = Adjustment(problem, held).minimise()
    names = [f"E_{error}{axis}" for axis in "XYZ" for error in "XYZ"]
    curves = {name: made.curve(name) for name in names}
    found = figures(problem, curves)
    freedom = len(made.entries) - len(made.column)
    further = {"degrees_of_freedom": freedom, "squares": digits(made.squares)}
    if alone:
        found = {name: v for name, v in found.items() if not name.startswith("positioning")}
        return {"least_squares": certified({}, found, None, **further)}
    for setup, n in made.nominal.items():
        if any(n[i] == 0 for i in range(3)):
            continue
        one, two = made.angles(setup)
        found[f"tilt {setup} 1"], found[f"tilt {setup} 2"] = one, two
    scale = mpf(1) if made.known else mp.sqrt(made.squares / freedom)
    own = {
        name: [scale * u for u in made.curve_uncertainty(name, made.at_nominal)] for name in names
    }
    moved = {
        name: [scale * u for u in made.curve_uncertainty(name, made.at_minimum)] for name in names
    }
    answer = certified(curves, found, own, **further)
    answer["standard_uncertainty_at_minimum"] = {
        name: [digits(v) for v in values] for name, values in moved.items()
    }
    return {"least_squares": answer}


def document(problem):
    return {
        "name": problem.name,
        "description": problem.description,
        "digits_carried": mp.dps,
        "step_m": problem.step,
        "origin_m": problem.origin,
        "blocks": problem.blocks,
        "size_m": problem.size,
        "noise_m": problem.noise,
        "tilt_rad": problem.tilt,
        "lines": [
            {
                "name": line.name,
                "order": line.order,
                "repeat": line.repeat,
                "direction": line.direction,
                "standard_uncertainty_m": line.uncertainty,
                "reading_m": line.reading,
            }
            for line in problem.passes
        ],
        "certified": {**by_formulations(problem), **by_adjustment(problem)},
    }


def main(wanted):
    TARGET.mkdir(exist_ok=True)
    for problem in problems():
        if wanted and problem.name not in wanted:
            continue
        problem.measure()
        if problem.name == "unequal_weights":
            made = {**document(problem)}
            # The formulations average passes alike, whatever their weight, and want every move.
            made["certified"] = by_adjustment(problem)
        else:
            made = document(problem)
        path = TARGET / f"solver_{problem.name}.json"
        path.write_text(json.dumps(made, indent=1) + "\n")
        print(path.name)


if __name__ == "__main__":
    main(sys.argv[1:])
