"""The case file beside a run table: what is known of the machine and the laser."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any

import yaml

from stepdiag_ros.bags.errors import TableError
from stepdiag_ros.configuration import parse_yaml
from stepdiag_ros.metrology.checking import Section
from stepdiag_ros.metrology.geometry import AXES, CHAINS
from stepdiag_ros.metrology.plan import Volume

FILE_NAME = "case.yaml"
UNITS = "SI"


@dataclass(frozen=True)
class Case:
    """What a case file tells; whatever it does not tell stays unknown.

    Attributes:
        chain: order of the axes from workpiece to tool, for example YXZ; empty if unknown.
        volume: the measured box; None if origin, step and blocks are to be seen from the positions.
        dead_path: from the laser's reference to the mirror at the first stop of a line, m; NaN if
            unknown.
        reading_noise: standard deviation of one reading, m; NaN if unknown.
        mirror_on: ``tool`` or ``workpiece``; empty if unknown.
        laser_on: ``workpiece`` or ``tool``; empty if unknown.
        text: of the file; empty if there was none.
    """

    chain: str = ""
    volume: Volume | None = None
    dead_path: float = float("nan")
    reading_noise: float = float("nan")
    mirror_on: str = ""
    laser_on: str = ""
    text: str = ""

    def machine_text(self, source: str) -> str:
        """Return the YAML text of what is known of the machine, for the description of a run."""
        known: dict[str, Any] = {"name": f"as told by {source}" if self.text else "unknown"}
        if self.chain:
            known["chain"] = self.chain
        return _yaml({**known, **self._optical()})

    def case_text(self) -> str:
        """Return the YAML text of a case file that tells the same."""
        told: dict[str, Any] = {"units": UNITS}
        if self.chain:
            told["chain"] = list(self.chain)
        if self.volume is not None:
            told["origin_m"] = [float(value) for value in self.volume.origin]
            told["step_m"] = [float(value) for value in self.volume.step]
            told["blocks"] = int(self.volume.blocks)
        return _yaml({**told, **self._optical()})

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


def read_case(path: Path) -> Case:
    """Read a case file (form: METROLOGY, "Run tables and cases").

    Raises:
        TableError: not there, not readable, or a value is wrong; names the file and the key.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise TableError(f"there is no case file {path}") from None
    except (OSError, UnicodeDecodeError):
        raise TableError(f"{path} cannot be read as text") from None
    try:
        return case_of(parse_yaml(text, str(path)) or {}, str(path), text)
    except ValueError as error:
        raise TableError(str(error)) from None


def case_of(mapping: Any, source: str, text: str = "") -> Case:
    """Make a case from parsed YAML; other keys than the known ones are left alone.

    Raises:
        ValueError: names the source, the key, what is wrong and what is expected.
    """
    section = Section(mapping, source)
    units = section.text("units", default=UNITS)
    if units != UNITS:
        raise ValueError(f"{source}: 'units' is {units!r}; only {UNITS} is understood")
    unknown = float("nan")
    return Case(
        chain=_chain(section, mapping),
        volume=_volume(section, mapping, source),
        dead_path=_number(section, mapping, "dead_path_m", unknown),
        reading_noise=_number(section, mapping, "reading_noise_m", unknown),
        mirror_on=section.text("mirror_on", default=""),
        laser_on=section.text("laser_on", default=""),
        text=text,
    )


def _chain(section: Section, mapping: Mapping[str, Any]) -> str:
    if "chain" not in mapping:
        return ""
    if isinstance(mapping["chain"], str):
        return section.names("chain", CHAINS)[0]
    return "".join(section.names("chain", AXES))


def _volume(section: Section, mapping: Mapping[str, Any], source: str) -> Volume | None:
    if "step_m" not in mapping and "blocks" not in mapping:
        return None
    chain = mapping.get("chain", "")
    if chain and len(chain) != len(AXES):
        raise ValueError(f"{source}: 'chain' is {chain!r}; expected the three axes in an order")
    return Volume(
        origin=section.vector("origin_m", default=(0.0, 0.0, 0.0)),
        step=section.vector("step_m", low=1e-6, high=10.0),
        blocks=section.integer("blocks", low=1, high=1000),
    )


def _number(section: Section, mapping: Mapping[str, Any], key: str, unknown: float) -> float:
    return section.number(key, low=0.0, high=1e3) if key in mapping else unknown


def _yaml(mapping: dict[str, Any]) -> str:
    return str(yaml.safe_dump(mapping, sort_keys=False, default_flow_style=None))
