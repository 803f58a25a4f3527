"""What is done to an archive: add bags, bring its catalogue up to date, verify it."""

import hashlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from stepdiag_ros import __version__
from stepdiag_ros.archive.catalogue import FEW, FOLDER, Catalogue, part_of_bag, tidy, write_part
from stepdiag_ros.archive.columns import TABLES
from stepdiag_ros.archive.engine import Engine, each
from stepdiag_ros.archive.place import Place
from stepdiag_ros.archive.rows import rows_of_bag
from stepdiag_ros.bags.digest import sha256_of
from stepdiag_ros.bags.folder import METADATA_FILE, SUFFIXES
from stepdiag_ros.bags.seal import seal_path
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.text.sentence import sentence

BAGS = "bags"
"""Folder of the bags; each is in a folder that is named by its SHA-256."""
_PIECE = 2**20


@dataclass(frozen=True)
class Outcome:
    """What has become of one bag.

    Attributes:
        file: its name, or the path that was given.
        problem: why it is not in the archive, or not evaluated; empty if all is well.
        same_as: name under which the same bag was in the archive before; empty if it was not.
        evaluated: rows of it were written now.
    """

    file: str
    problem: str = ""
    same_as: str = ""
    evaluated: bool = False


def bags_of(place: Place) -> dict[str, str]:
    """Return the bags of an archive: SHA-256 → name in the place."""
    found: dict[str, str] = {}
    for name in place.names(BAGS):
        _, sha256, file = name.split("/", 2) if name.count("/") == 2 else ("", "", "")
        if file.endswith(SUFFIXES):
            found.setdefault(sha256, name)
    return found


def bags_below(paths: Iterable[Path]) -> list[Path]:
    """Return the bags that are given, and those in the folders that are given.

    Raises:
        ValueError: a path is not there, or a folder holds no bag.
    """
    found = []
    for path in paths:
        inside = [one for one in sorted(path.rglob("*")) if one.name.endswith(SUFFIXES)]
        if not path.exists() or (path.is_dir() and not inside):
            what = "holds no bag (.mcap)" if path.is_dir() else "is not there"
            raise Refusal(f"{path} {what}", fault="not_found", where=str(path))
        found += inside if path.is_dir() else [path]
    return found


def add(place: Place, bags: Sequence[Path], engine: Engine) -> Iterator[Outcome]:
    """Add bags to an archive and evaluate those that are new; yield what becomes of each.

    After a kill the same bags may be added again: existing ones are left as they are.

    Raises:
        ValueError: the catalogue is damaged, or the scheduler does not answer.
    """
    known = bags_of(place)
    evaluated = _evaluated(place)
    refused: list[Outcome] = []
    there: dict[str, str] = {}

    def taken() -> Iterator[str]:
        for bag in bags:
            try:
                sha256, before = _take(place, bag, known)
            except (ValueError, OSError) as error:
                refused.append(Outcome(str(bag), sentence(error)))
                continue
            if before:
                there[str(bag)] = before
            if sha256 not in evaluated:
                evaluated.add(sha256)
                yield known[sha256]

    for done in _evaluate(place, taken(), engine):
        yield done
        yield from _emptied(refused)
    yield from _emptied(refused)
    for file, before in there.items():
        yield Outcome(file, same_as=before)


def update(place: Place, engine: Engine) -> tuple[int, Iterator[Outcome]]:
    """Evaluate the bags that this version of the software has not, and tidy the catalogue.

    Returns:
        number of bags to evaluate; what becomes of each.

    Raises:
        ValueError: a part of the catalogue is damaged, or the scheduler does not answer.
    """
    evaluated = _evaluated(place)
    missing = [name for sha256, name in bags_of(place).items() if sha256 not in evaluated]
    return len(missing), _evaluate(place, missing, engine)


def verify(place: Place, progress: Callable[[float, str], None]) -> list[str]:
    """Return what is wrong with an archive, a sentence each; nothing if it is whole.

    Each bag is read and compared with its name, each part of the catalogue is read, and both are
    compared with each other.

    Args:
        place: of the archive.
        progress: called with the part that is done (0..1), and what is being looked at.
    """
    bags = bags_of(place)
    wrong = []
    for number, (sha256, name) in enumerate(bags.items()):
        progress(number / len(bags), name.rpartition("/")[2])
        if _digest(place, name) != sha256:
            wrong.append(f"{name} is not the bag that was added: its content has changed")
    with Catalogue(place) as catalogue:
        wrong += [
            f"part {part} of the catalogue lacks a file: remove the others of that name, and run"
            " 'stepdiag archive update'"
            for part in catalogue.incomplete_parts()
        ]
        if wrong:
            return wrong
        wrong += _different(catalogue)
        known = {one["bag_sha256"] for one in catalogue.ask("select bag_sha256 from runs")}
    remedy = f"run 'stepdiag archive update {place.url}'"
    wrong += [f"{bags[one]} is not in the catalogue: {remedy}" for one in sorted({*bags} - known)]
    wrong += [
        f"the catalogue has a run of bag {one}, which is not in the archive: add the bag again"
        for one in sorted(known - {*bags})
    ]
    return wrong


def _different(catalogue: Catalogue) -> list[str]:
    """Return which runs do not have the rows that they should have."""
    query = "select run_id, file from rows_runs r where false"
    for table in [table for table in TABLES if table != "runs"]:
        counted = f"(select count(*) from rows_{table} t where t.bag_sha256 = r.bag_sha256 and"
        query += f" or {table[:-1]}_count <> {counted} t.run_id is not distinct from r.run_id)"
    return [
        f"run {row['run_id']} of {row['file']} has other rows than it was evaluated with: remove"
        " the catalogue, and make it again with 'stepdiag archive update'"
        for row in catalogue.ask(query)
    ]


def _take(place: Place, bag: Path, known: dict[str, str]) -> tuple[str, str]:
    """Put a bag, and a seal beside it, into the place; return its SHA-256 and its earlier name."""
    # A folder of thousands of bags is not listed for each of them.
    if (bag.parent / METADATA_FILE).exists():
        split = [one for one in bag.parent.iterdir() if one.name.endswith(SUFFIXES)]
        if len(split) > 1:
            raise Refusal(
                f"{bag} is one of {len(split)} files of a bag: join them with 'ros2 bag convert'"
                " and add the whole",
                fault="unsupported",
            )
    if not bag.name.endswith(SUFFIXES):
        raise Refusal(
            f"{bag} is not a bag (.mcap): 'stepdiag import' makes one of it", fault="wrong_kind"
        )
    sha256 = sha256_of(bag)
    before = known.get(sha256, "").rpartition("/")[2]
    if not before:
        name = f"{BAGS}/{sha256}/{bag.name}"
        place.put(bag, name)
        if seal_path(bag).exists():
            place.put(seal_path(bag), f"{BAGS}/{sha256}/{seal_path(bag).name}")
        if sha256_of(bag) != sha256:
            place.remove(name)
            raise Refusal(f"{bag} has changed while it was added: add it again", fault="mismatch")
        known[sha256] = name
    return sha256, before


def _evaluated(place: Place) -> set[str]:
    try:
        with Catalogue(place) as catalogue:
            return catalogue.evaluated()
    except Refusal as refusal:
        if refusal.aspect != "catalogue":
            raise
        return set()


def _evaluate(place: Place, names: Iterable[str], engine: Engine) -> Iterator[Outcome]:
    work = partial(evaluate_bag, place.url, __version__)
    for number, done in enumerate(each(work, names, engine), 1):
        file = done.item.rpartition("/")[2]
        yield Outcome(file, done.failure or done.value or "", evaluated=not done.failure)
        if number % FEW == 0:  # not only at the end, so that nothing grows with the number of bags
            tidy(place)
    if place.names(FOLDER):
        tidy(place)


def evaluate_bag(url: str, version: str, name: str) -> str:
    """Evaluate a bag of an archive and write its part of the catalogue; the task of a worker.

    Args:
        url: of the archive.
        version: of the software that the task is from.
        name: of the bag in the archive.

    Returns:
        Why a run of it could not be evaluated, in a sentence; empty if all were.

    Raises:
        ValueError: this process has another version of the software.
        OSError: the bag cannot be read, or the part cannot be written.
    """
    if version != __version__:
        raise Refusal(
            f"a worker has stepdiag_ros {__version__}, and the task is from {version}: install one"
            " version everywhere",
            fault="mismatch",
            aspect="version",
        )
    place = Place(url)
    sha256 = name.split("/")[1]
    part = part_of_bag(sha256)
    with place.as_local(name) as bag:
        rows = rows_of_bag(bag, sha256, part)
    write_part(place, part, rows)
    return " ".join(run.problem for run in rows.runs if run.problem)


def _digest(place: Place, name: str) -> str:
    digest = hashlib.sha256()
    with place.opened(name) as file:
        while piece := file.read(_PIECE):
            digest.update(piece)
    return digest.hexdigest()


def _emptied(outcomes: list[Outcome]) -> Iterator[Outcome]:
    while outcomes:
        yield outcomes.pop(0)
