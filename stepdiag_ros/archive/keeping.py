"""The bag of a run into an archive, and what the history of its machine shows then."""

from dataclasses import dataclass
from pathlib import Path

from stepdiag_ros.archive.catalogue import Catalogue
from stepdiag_ros.archive.engine import Engine
from stepdiag_ros.archive.histories import MachineHistory, histories
from stepdiag_ros.archive.place import Place
from stepdiag_ros.archive.work import add
from stepdiag_ros.bags.digest import sha256_of


@dataclass(frozen=True)
class Kept:
    """What has become of a bag.

    Attributes:
        problem: why it is not in the archive, or not evaluated; empty if all is well.
        machine: name in the archive; empty if the bag states none.
        history: of the machine with this run; None without a name, or where no run of it has a date
            and a figure.
    """

    problem: str
    machine: str
    history: MachineHistory | None


def keep(url: str, bag: Path) -> Kept:
    """Add a bag to an archive; a bag that is there already is left as it is.

    Args:
        url: of the archive.
        bag: file of a run that is over.

    Raises:
        ValueError: the catalogue is damaged.
        OSError: the bag cannot be read, or the archive cannot be written.
    """
    place = Place(url)
    problems = [one.problem for one in add(place, [bag], Engine(1, "")) if one.problem]
    with Catalogue(place) as catalogue:
        rows = catalogue.ask("select machine from runs where bag_sha256 = ?", [sha256_of(bag)])
        machine = next((row["machine"] for row in rows if row["machine"]), "")
        history = _history(catalogue, machine) if machine else None
    return Kept(" ".join(problems), machine, history)


def history_of(url: str, machine: str) -> MachineHistory | None:
    """Return the history of a machine; None if the archive has no dated figure of it.

    Raises:
        ValueError: a part of the catalogue is damaged.
    """
    with Catalogue(Place(url)) as catalogue:
        return _history(catalogue, machine)


def _history(catalogue: Catalogue, machine: str) -> MachineHistory | None:
    dated = "select 1 from figures where machine = ? and time is not null limit 1"
    if not catalogue.ask(dated, [machine]):
        return None
    return next(iter(histories(catalogue, machine)), None)
