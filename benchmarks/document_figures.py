"""Lists computed figures of the documents that are out of date, or renews them.

Each figure stands in its document between two comments, or where an expression finds it. A test
compares all of them with what is computed (``test/documents/test_document_figures.py``). After a
change of solvers, diagnosis or simulation:

    python benchmarks/document_figures.py --write
"""

import argparse
import re
import sys
from collections.abc import Callable
from difflib import unified_diff
from functools import cache
from pathlib import Path
from typing import NamedTuple

from stepdiag_ros.archive.columns import TABLES, described
from stepdiag_ros.bags.table import read_table
from stepdiag_ros.configuration import load_cell, load_plan
from stepdiag_ros.evaluation.diagnosis import DiagnosisReport, build_diagnosis
from stepdiag_ros.evaluation.solving import solve_reproducibly
from stepdiag_ros.metrology.effects import catalogue
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.model import MachineModel
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.solvers.catalogue import own_methods
from stepdiag_ros.metrology.table_one import TableOneRow, table_one
from stepdiag_ros.text.numbers import plain, plus_minus
from stepdiag_ros.words.diagnosis import sizes_words

ROOT = Path(__file__).parents[1]
CASES = ROOT / "test" / "data" / "cases"
HIDDEN = {
    "effect_a": "backlash of X, 0.8 µm",
    "effect_b": "thermal growth of Z, 12 µm/(m K)",
    "effect_c": "E_CZ, 20 u + 5 u² µrad",
    "effect_d": "dead path, 0.5 µm/K",
    "effect_e": "fringe slip, 0.316 µm",
    "effect_f": "settling of Y, 0.4 µm",
}
PRINTED_TABLE_1 = {
    "Positioning error in X": ("positioning X", "1.7", "- (measured 0.8)"),
    "Positioning error in Y": ("positioning Y", "-18.3", "- (measured 0.2)"),
    "Positioning error in Z": ("positioning Z", "20.9", "- (measured -1.1)"),
    "Squareness of X-Y": ("squareness X-Y", "3.2", "-1.4"),
    "Squareness of X-Z": ("squareness X-Z", "-4.3", "0.1"),
    "Squareness of Y-Z": ("squareness Y-Z", "-3.9", "-0.1"),
}
"""Row of Table 1 of Ibaraki & Hata 2010 → its name here, conventional and proposed value, µm."""
_MICRO = 1e6


class Figure(NamedTuple):
    """A figure: its document from the root, the expression that finds it, and what it must be.

    The one group of the expression is what the computation fills, at every place where it fits.
    """

    document: str
    found_by: str
    make: Callable[[], str]


def marked(name: str) -> str:
    """Return the expression that finds what stands between the two comments of a name."""
    begin = f"<!-- {name}: written by benchmarks/document_figures.py, not by hand -->"
    return f"{re.escape(begin)}(.*?){re.escape(f'<!-- {name}: end -->')}"


def diagnosed(measurement: Measurement) -> DiagnosisReport:
    return build_diagnosis(measurement, MachineModel(), catalogue(), again=False)


@cache
def diagnosis_of(case: str) -> DiagnosisReport:
    return diagnosed(read_table(CASES / case / "run.csv"))


@cache
def table_1() -> dict[str, TableOneRow]:
    """Return Table 1 of one simulated run of Ibaraki & Hata's plan, five repeats."""
    plan, cell = load_plan("ibaraki_hata_2010")[0], load_cell("ibaraki_hata_2010")[0]
    results, _ = solve_reproducibly(simulate(plan, cell, seed=1, readings_per_stop=50))
    shown = {method: results[method] for method in ("conventional", "setup_robust")}
    return {row.label: row for row in table_one(shown)}


def named_effects() -> str:
    rows = ["| hidden | named | χ²/dof held out, before → after |", "|---|---|---|"]
    for case, hidden in HIDDEN.items():
        report = diagnosis_of(case)
        found, proof = report.diagnosis, report.held_out
        named = "; ".join(f"{one.label}, {sizes_words(one)}" for one in found.findings)
        gap = "-"
        if proof is not None:
            before, after = plain(proof.before.reduced, 2), plain(proof.after.reduced, 2)
            gap = f"{before} → {after} ({proof.split})"
        rows.append(f"| {hidden} | {found.verdict}: {named} | {gap} |")
    return block(rows)


def seen_patterns() -> str:
    rows = ["| hidden | reported |", "|---|---|"]
    for case in ("effect_a", "effect_b", "effect_e", "effect_f"):
        told = []
        for one in diagnosis_of(case).diagnosis.patterns:
            also = f"; or as well: {', '.join(one.or_else)}" if one.or_else else ""
            told.append(f"{one.words}, {100 * one.share:.0f} % of what exceeds noise{also}")
        rows.append(f"| {HIDDEN[case].split(',')[0]} (`{case}`) | {'; then '.join(told)} |")
    return block(rows)


def table_1_beside_the_paper() -> str:
    rows = [
        "| over 120 mm, µm | Table 1, conventional | simulated cell, conventional"
        " | Table 1, proposed | cell, setup-robust |",
        "|---|---|---|---|---|",
    ]
    for label, (name, conventional, proposed) in PRINTED_TABLE_1.items():
        of_cell = table_1()[label].estimated
        ours, robust = (
            plus_minus(of_cell[method].value, of_cell[method].standard_uncertainty, _MICRO)
            for method in ("conventional", "setup_robust")
        )
        rows.append(f"| {name} | {conventional} | {ours} | {proposed} | {robust} |")
    return block(rows)


def conventional_in_short() -> str:
    values = [
        plain(table_1()[label].estimated["conventional"].value * _MICRO, 2)
        for label in PRINTED_TABLE_1
    ]
    return f"{', '.join(values[:3])}; {', '.join(values[3:])} µm"


def passes_and_stops() -> str:
    plan = load_plan("demo")[0]
    return f"{len(plan.lines)} passes, {plan.stop_count} stops"


@cache
def candidates() -> int:
    plan, cell = load_plan("demo")[0], load_cell("hidden_backlash")[0]
    found = diagnosed(simulate(plan, cell, seed=1, readings_per_stop=30))
    return found.diagnosis.tested


def block(rows: list[str]) -> str:
    return "\n" + "\n".join(rows) + "\n"


def catalogue_table() -> str:
    """Return the effects of the catalogue: what happens, where and how, sizes with their range."""
    rows = ["| effect | what happens | setting | sizes |", "|---|---|---|---|"]
    for effect in catalogue().values():
        keys = ", ".join(f"`{key.name}`" for key in effect.keys)
        sizes = "; ".join(
            f"`{size.name}`: {size.low:g} to {size.high:g} {size.unit}" for size in effect.sizes
        )
        rows.append(f"| {effect.name} | {effect.sentence} | {keys} | {sizes} |")
    return block(rows)


def solvers_table() -> str:
    """Return the solvers of the package: title, needed lines, source, and function."""
    rows = ["| method | title | needs | source | function |", "|---|---|---|---|---|"]
    for one in own_methods():
        if one.solve is not None:
            module = one.solve.__module__.removeprefix("stepdiag_ros.")
            function = f"`{module}.{one.solve.__name__}`"
            rows.append(f"| `{one.name}` | {one.title} | {one.needs} | {one.source} | {function} |")
    return block(rows)


def archive_columns() -> str:
    """Return the columns of each table of an archive's catalogue."""
    rows: list[str] = []
    for table, kind in TABLES.items():
        rows += [f"### {table}", "", (kind.__doc__ or "").strip(), ""]
        rows += ["| column | type | meaning |", "|---|---|---|"]
        rows += [
            f"| `{name}` | {what} | {text} |" for name, (what, text) in described(table).items()
        ]
        rows += [""]
    return block(rows)


FIGURES = {
    "archive columns": Figure("docs/archive.md", marked("archive columns"), archive_columns),
    "catalogue": Figure("docs/effects.md", marked("catalogue"), catalogue_table),
    "solvers": Figure("docs/methods.md", marked("solvers"), solvers_table),
    "named effects": Figure("docs/diagnose.md", marked("named effects"), named_effects),
    "seen patterns": Figure("docs/diagnose.md", marked("seen patterns"), seen_patterns),
    "table 1": Figure("docs/ibaraki_hata.md", marked("table 1"), table_1_beside_the_paper),
    "conventional": Figure("docs/methods.md", marked("conventional"), conventional_in_short),
    "passes": Figure("docs/tutorial/1_measure.md", r"(\d+ passes, [\d,]+ stops)", passes_and_stops),
    "candidates": Figure(
        "docs/tutorial/3_diagnose.md", r"([\d,]+) candidates tried", lambda: f"{candidates():,}"
    ),
    "some candidates": Figure(
        "docs/tutorial/3_diagnose.md",
        r"some ([\d,]+) candidates",
        lambda: f"{round(candidates(), -2):,}",
    ),
}


def texts(figure: Figure) -> list[str]:
    """Return what the document has at each place of a figure.

    Raises:
        ValueError: the document has no such place.
    """
    whole = (ROOT / figure.document).read_text(encoding="utf-8")
    found = [match[1] for match in re.finditer(figure.found_by, whole, re.DOTALL)]
    if not found:
        raise ValueError(f"{figure.document} has no place for the figure: {figure.found_by}")
    return found


def write(figure: Figure, text: str) -> None:
    """Put a figure into its document, at each of its places."""
    path = ROOT / figure.document
    whole = path.read_text(encoding="utf-8")

    def with_figure(match: re.Match[str]) -> str:
        start, end = match.start(1) - match.start(), match.end(1) - match.start()
        return match[0][:start] + text + match[0][end:]

    path.write_text(re.sub(figure.found_by, with_figure, whole, flags=re.DOTALL), encoding="utf-8")


_NUMBER = re.compile(r"-?\d[\d,]*(?:\.(\d+))?")


def alike(text: str, other: str) -> bool:
    """Say whether two texts are the same but for one unit of the last digit of their numbers.

    Numerical libraries differ in their last bits, which may turn a digit over.
    """
    if _NUMBER.sub("#", text) != _NUMBER.sub("#", other):
        return False
    for one, two in zip(_NUMBER.finditer(text), _NUMBER.finditer(other), strict=True):
        decimals = min(len(one[1] or ""), len(two[1] or ""))
        first, second = (float(number[0].replace(",", "")) for number in (one, two))
        unit = 10.0**-decimals if decimals else 0.0
        if abs(first - second) > 1.001 * unit:
            return False
    return True


def differences(text: str, other: str) -> str:
    """Return the lines of a document, with -, and those computed, with +, that are not alike."""
    lines, computed = text.splitlines(), other.splitlines()
    if len(lines) != len(computed):
        rows = unified_diff(lines, computed, lineterm="", n=0)
        return "\n".join(row for row in rows if not row.startswith(("---", "+++", "@@")))
    pairs = zip(lines, computed, strict=True)
    return "\n".join(f"-{one}\n+{two}" for one, two in pairs if not alike(one, two))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--write", action="store_true", help="renew them in the documents")
    parser.add_argument(
        "--only",
        choices=tuple(FIGURES),
        action="append",
        help="renew or check this figure only; may be repeated",
    )
    arguments = parser.parse_args()
    old = 0
    for name in arguments.only or FIGURES:
        figure = FIGURES[name]
        text = figure.make()
        same = all(alike(found, text) for found in texts(figure))
        old += not same
        how = "as computed" if same else "renewed" if arguments.write else "of an older state"
        print(f"{figure.document}, {name}: {how}")
        if arguments.write and not same:
            write(figure, text)
        elif not same:
            print("\n".join(differences(found, text) for found in texts(figure)))
    return 1 if old and not arguments.write else 0


if __name__ == "__main__":
    sys.exit(main())
