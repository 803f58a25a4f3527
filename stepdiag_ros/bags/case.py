"""The case file beside a run table: what is known of the machine and the laser."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from typing import Any

import yaml

from stepdiag_ros.bags.errors import TableError
from stepdiag_ros.metrology.checking import UNKNOWN, Section
from stepdiag_ros.metrology.geometry import AXES, CHAINS
from stepdiag_ros.metrology.machine import told_rotations
from stepdiag_ros.metrology.plan import BOX_KEYS, COURSE_KEYS, LARGEST_OVERRUN, Volume
from stepdiag_ros.metrology.plausible import ORDINARY, ROTATIONS_KEY, Plausible
from stepdiag_ros.metrology.refusal import Refusal, fields_of
from stepdiag_ros.text.intake import parse_yaml

FILE_NAME = "case.yaml"
UNITS = "SI"
SIMULATED_CELL = "simulated_cell"
FACTS = (
    "machine",
    "machine_serial_number",
    "instrument",
    "instrument_serial_number",
    "test_date",
    "operator",
    "expansion_coefficient_per_K",
    "compensation_state",
    SIMULATED_CELL,
)
"""Facts about a measurement that a case file may state in words."""
_TOLD_BY = "as told by "


@dataclass(frozen=True)
class Case:
    """Contents of a case file; whatever it does not state stays unknown.

    Attributes:
        chain: order of the axes from workpiece to tool, for example YXZ; empty if unknown.
        rotations: plausible size of the axes' rotations, rad (``metrology.plausible``); None if
            unknown.
        volume: the measured box; None if origin, step and blocks are to be seen from the positions.
        dead_path: from the laser's reference to the mirror at the first stop of a line, m; NaN if
            unknown.
        reading_noise: standard deviation of one reading, m; NaN if unknown.
        mirror_on: ``tool`` or ``workpiece``; empty if unknown.
        laser_on: ``workpiece`` or ``tool``; empty if unknown.
        plan: keys of a plan file that the case file states (``COURSE_KEYS``), unchanged.
        facts: machine, instrument, serial numbers … in words (``FACTS``).
        text: of the file; empty if there was none.
        source: what the user calls the file.
    """

    chain: str = ""
    rotations: float | None = None
    volume: Volume | None = None
    dead_path: float = float("nan")
    reading_noise: float = float("nan")
    mirror_on: str = ""
    laser_on: str = ""
    plan: Mapping[str, Any] = field(default_factory=dict)
    facts: Mapping[str, str] = field(default_factory=dict)
    text: str = ""
    source: str = ""

    @property
    def one_alignment_per_diagonal(self) -> bool:
        """Say whether all orders of a step diagonal were measured in one setup; see ``Plan``."""
        return bool(self.plan.get("one_alignment_per_diagonal", False))

    @property
    def overrun(self) -> float:
        """Return how far beyond its first stop each line but a step diagonal was begun, m."""
        return float(self.plan.get("overrun_m", 0.0))

    @property
    def plausible(self) -> Plausible:
        """Return what may act unseen: the ordinary, unless the file states the rotations."""
        return ORDINARY if self.rotations is None else Plausible(rotation=self.rotations)

    @property
    def tells_of_the_machine(self) -> bool:
        """Say whether anything but a name is known of the machine."""
        return bool(self.chain or self._turning() or self._optical())

    def machine_text(self, source: str) -> str:
        """Return the YAML text of what is known of the machine, for the description of a run."""
        name = f"{_TOLD_BY}{source}" if self.text else UNKNOWN
        known: dict[str, Any] = {"name": self.facts.get("machine", name)}
        if self.chain:
            known["chain"] = self.chain
        known |= self._turning()
        return _yaml({**known, **self._optical()})

    def case_text(self) -> str:
        """Return the YAML text of an equivalent case file."""
        told: dict[str, Any] = {"units": UNITS}
        if self.chain:
            told["chain"] = list(self.chain)
        told |= self._turning()
        if self.volume is not None:
            told["origin_m"] = [float(value) for value in self.volume.origin]
            told["step_m"] = [float(value) for value in self.volume.step]
            told["blocks"] = int(self.volume.blocks)
        facts = {"facts": dict(self.facts)} if self.facts else {}
        return _yaml({**told, **self.plan, **self._optical(), **facts})

    def _turning(self) -> dict[str, Any]:
        return {} if self.rotations is None else {ROTATIONS_KEY: self.rotations}

    def _optical(self) -> dict[str, Any]:
        told: dict[str, Any] = {
            key: value
            for key, value in (("mirror_on", self.mirror_on), ("laser_on", self.laser_on))
            if value
        }
        if isfinite(self.dead_path):
            told["dead_path_m"] = self.dead_path
        if isfinite(self.reading_noise):
            told["reading_noise_m"] = self.reading_noise
        return told


def is_assumed_name(machine: str) -> bool:
    """Say whether a machine's name is the one that a machine without a name gets here."""
    return machine == UNKNOWN or machine.startswith(_TOLD_BY)


def read_case(path: Path) -> Case:
    """Read a case file (form: ``docs/import.md``, "Run tables").

    Raises:
        TableError: not there, not readable, or a value is wrong; names the file and the key.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise TableError(f"there is no case file {path}", fault="not_found") from None
    except (OSError, UnicodeDecodeError):
        raise TableError(f"{path} cannot be read as text") from None
    try:
        return case_of(parse_yaml(text, str(path)) or {}, str(path), text)
    except ValueError as error:
        raise TableError(str(error), **fields_of(error)) from None


def case_of(mapping: Any, source: str, text: str = "") -> Case:
    """Make a case from parsed YAML.

    Raises:
        ValueError: a key is unknown or its value wrong; names the source, the key, what is wrong
            and what is expected.
    """
    section = Section(mapping, source)
    units = section.text("units", default=UNITS)
    if units != UNITS:
        raise Refusal(
            f"{source}: 'units' is {units!r}; only {UNITS} is understood", fault="unsupported"
        )
    unknown = float("nan")
    # What the plan's own reader checks later is checked here where the case itself builds on it.
    section.flag("one_alignment_per_diagonal", default=False)
    section.number("overrun_m", low=0.0, high=LARGEST_OVERRUN, default=0.0)
    made = Case(
        chain=_chain(section, mapping),
        rotations=told_rotations(section),
        volume=_volume(section, mapping, source),
        dead_path=_number(section, mapping, "dead_path_m", unknown),
        reading_noise=_number(section, mapping, "reading_noise_m", unknown),
        mirror_on=section.text("mirror_on", default=""),
        laser_on=section.text("laser_on", default=""),
        plan=section.given(COURSE_KEYS),
        facts=facts_of(section),
        text=text,
        source=source,
    )
    section.finish()
    return made


def facts_of(top: Section) -> dict[str, str]:
    """Return the facts in a section ``facts``, as texts: those of ``FACTS`` that are there.

    Raises:
        ValueError: another fact is there, or one is not text.
    """
    section = top.section("facts")
    made = {}
    for name in FACTS:
        if name.endswith("_per_K"):
            made[name] = f"{section.number(name, default=0.0):.9g}"
        else:
            made[name] = section.day(name, "") if name.endswith("_date") else section.text(name, "")
    section.finish()
    return {name: text for name, text in made.items() if name in section.keys()}  # noqa: SIM118


def _chain(section: Section, mapping: Mapping[str, Any]) -> str:
    if "chain" not in mapping:
        return ""
    if isinstance(mapping["chain"], str):
        return section.names("chain", CHAINS)[0]
    return "".join(section.names("chain", AXES))


def _volume(section: Section, mapping: Mapping[str, Any], source: str) -> Volume | None:
    if not any(key in mapping for key in BOX_KEYS):
        return None
    chain = mapping.get("chain", "")
    if chain and len(chain) != len(AXES):
        raise Refusal(
            f"{source}: 'chain' is {chain!r}; expected the three axes in an order",
            fault="malformed",
        )
    return Volume(
        origin=section.vector("origin_m", default=(0.0, 0.0, 0.0)),
        step=section.vector("step_m", low=1e-6, high=10.0),
        blocks=section.integer("blocks", low=1, high=1000),
    )


def _number(section: Section, mapping: Mapping[str, Any], key: str, unknown: float) -> float:
    return section.number(key, low=0.0, high=1e3) if key in mapping else unknown


def _yaml(mapping: dict[str, Any]) -> str:
    return str(yaml.safe_dump(mapping, sort_keys=False, default_flow_style=None))
