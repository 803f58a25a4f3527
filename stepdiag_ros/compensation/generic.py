"""The generic form: the whole error map with ISO 230-1 names, as JSON and as CSV.

``volumetric_map.json`` (schema ``volumetric_map``) is what target correction by the bridge and the
rewriting of NC programs take, and what any other software can: nodes, curves, uncertainty, chain,
frame, reversal, in SI units. ``error_curves.csv`` holds the same curves in the table that
``stepdiag compare --measured`` reads, ``error_grid.csv`` the error vectors at all nodes.
"""

import hashlib
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from stepdiag_ros import schemas
from stepdiag_ros.compensation.control import ControlSetting, Files, Layout
from stepdiag_ros.compensation.identified import Identified, Origin, known_numbers
from stepdiag_ros.metrology.discrepancy.summary import Verdict
from stepdiag_ros.metrology.geometry import AXES, REFERENCE_POINT, TRANSLATIONS, Vector
from stepdiag_ros.metrology.learned_displacement import LearnedDisplacement
from stepdiag_ros.metrology.machine import Machine
from stepdiag_ros.metrology.refusal import Refusal, fields_of
from stepdiag_ros.metrology.target_correction import target_for
from stepdiag_ros.metrology.volumetric_map import VolumetricMap
from stepdiag_ros.schemas.origin import origin_of
from stepdiag_ros.schemas.volumetric_map import Document, LearnedPart, Nodes
from stepdiag_ros.text.controls import Comment
from stepdiag_ros.text.intake import parse_json

if TYPE_CHECKING:
    from stepdiag_ros.run.target_correction import TargetCorrection

MAP = "volumetric_map.json"
CURVES_TABLE = "error_curves.csv"
GRID_TABLE = "error_grid.csv"
_CURVES_TITLE = "name,position_m,repeat,value,standard_uncertainty,definition"
_GRID_TITLE = "x_m,y_m,z_m,error_x_m,error_y_m,error_z_m"
COMMENT = Comment("# ", signs=".+-/=[]:_")
"""Without commas: in a spreadsheet a note is one cell, which begins with ``#``."""
_NUMBER = r"-?[0-9.]+(?:e[+-][0-9]+)?"
DEFINITION = (
    "error of the tool relative to the workpiece: actual less commanded position, zero at the first"
    " corner of the box; to come to a place, subtract the error there from the target"
)
MOST_ROWS = 100_000
ROUNDING = 1e-12
"""m or rad: of a value in the table of curves."""


@dataclass(frozen=True)
class CorrectedTargets:
    """Targets corrected by an error map (``applied.Applied``); the reversal errors stay.

    Attributes:
        error_map: of the machine.
    """

    error_map: VolumetricMap

    def sent(self, targets: Vector, forward: bool) -> Vector:  # noqa: ARG002
        """Return where the axes are sent (see ``Applied.sent``); NaN where nothing is known."""
        return target_for(self.error_map, targets)


class _Generic:
    name = "generic"
    title = "volumetric error map (JSON, CSV), for target correction by the bridge"
    settings: tuple[ControlSetting, ...] = ()
    corrects = TRANSLATIONS
    says = (
        "the map corrects everything in it, angular errors too, wherever targets can be changed:"
        " parameter 'correction' of the bridge, or a rewritten NC program",
        "it holds in the measured box; beyond its edge the bridge goes on with the correction of"
        " the nearest place, and nothing is claimed there",
        "reversal errors are listed, but the direction of approach to a target is unknown:"
        " targets are corrected by the mean of both directions",
    )
    source = "ISO 230-1 (names and signs), this package (schema volumetric_map)"
    grammar: ClassVar[dict[str, tuple[str, ...]]] = {
        # JSON marks what could be more than text in a string by itself.
        re.escape(MAP): ("[^\0-\x1f]*",),
        re.escape(CURVES_TABLE): (
            COMMENT.pattern,
            re.escape(_CURVES_TITLE),
            rf"E_[A-CX-Z][XYZ],{_NUMBER},0,{_NUMBER},({_NUMBER})?,",
        ),
        re.escape(GRID_TABLE): (
            COMMENT.pattern,
            re.escape(_GRID_TITLE),
            rf"{_NUMBER}(,{_NUMBER}){{2}}(,({_NUMBER})?){{3}}",
        ),
    }

    def holds_reversal(self, _settings: Mapping[str, Any]) -> bool:
        """Say whether the tables correct reversal errors (see ``Control``)."""
        return False

    def write(self, identified: Identified, layout: Layout) -> Files:
        """Return the map as JSON and the two tables.

        Raises:
            ValueError: nothing of the box is determined, or tables were at work in the run.
        """
        if layout.on_top_of.tables:
            raise ValueError(
                "a map cannot contain the tables of a control: leave these switched on, and the map"
                " corrects what they leave"
            )
        error_map = identified.error_map
        if not error_map.tells_any_node():
            raise ValueError(
                f"no error vector in the box is determined; not determined are"
                f" {', '.join(error_map.unknown_curves)}"
            )
        notes = "".join(f"{line}\n" for line in layout.comments(COMMENT))
        files = {
            MAP: schemas.json_text(schemas.document("volumetric_map", content(identified))) + "\n",
            CURVES_TABLE: notes + _beside_curves(error_map) + _curves(error_map),
        }
        if np.prod([len(nodes) for nodes in error_map.nodes]) <= MOST_ROWS:
            files[GRID_TABLE] = notes + _grid(error_map)
        return files

    def read(self, files: Mapping[str, str]) -> CorrectedTargets:
        """Return what target correction does with the map."""
        if MAP not in files:
            raise ValueError(f"there is no {MAP} among these files")
        return CorrectedTargets(map_from_text(files[MAP], MAP).error_map)


def content(identified: Identified) -> Document:
    """Return the map as the content of a document of the schema ``volumetric_map``."""
    error_map = identified.error_map
    return Document(
        definition=DEFINITION,
        origin=origin_of(asdict(identified.origin)),
        chain=error_map.chain or None,
        frame=error_map.frame,
        reference_point=REFERENCE_POINT,
        nodes=Nodes(**{axis: at.tolist() for axis, at in zip(AXES, error_map.nodes, strict=True)}),
        curves={name: curve.tolist() for name, curve in error_map.curves.items()},
        standard_uncertainty={
            name: spread.tolist() for name, spread in error_map.standard_uncertainty.items()
        },
        reversal={AXES[axis]: values.tolist() for axis, values in identified.reversal.items()},
        not_estimated=error_map.left_out,
        not_determined=error_map.not_determined,
        remarks=identified.remarks,
        **_learned_content(error_map),
    )


def _learned_content(error_map: VolumetricMap) -> dict[str, Any]:
    """Return what a map has beside its curves, as fields of its document."""
    if not error_map.learned:
        return {}
    parts = [
        LearnedPart(
            acts_on=one.acts_on,
            shape=one.shape,
            amplitude=one.amplitude,
            box={AXES[axis]: ends for axis, ends in one.box.items()},
        )
        for one in error_map.learned
    ]
    return {"learned": parts, "learned_covariance": error_map.learned_covariance.tolist()}


def map_from_text(text: str, source: str) -> Identified:
    """Return the map in a document of the schema ``volumetric_map``.

    Args:
        text: of the document.
        source: what the user calls it, for the text of an error.

    Raises:
        ValueError: it is not such a document; names the source and what is wrong.
    """
    document = parse_json(text, source)
    expected = schemas.identifier("volumetric_map")
    if not isinstance(document, dict) or document.get("schema") != expected:
        raise Refusal(
            f"{source} is not a volumetric map ({expected}). Make one with 'stepdiag compensate"
            " RESULT --for generic'",
            fault="wrong_kind",
        )
    try:
        x, y, z = (known_numbers(document["nodes"][letter]) for letter in AXES)
        error_map = VolumetricMap(
            nodes=(x, y, z),
            curves={name: known_numbers(curve) for name, curve in document["curves"].items()},
            standard_uncertainty={
                name: known_numbers(spread)
                for name, spread in document["standard_uncertainty"].items()
            },
            chain=document["chain"] or "",
            frame=document["frame"],
            not_determined=tuple(document["not_determined"]),
            **_learned(document),
        )
        reversal = {
            AXES.index(letter): known_numbers(values)
            for letter, values in document["reversal"].items()
        }
        origin = Origin(**{key: value or "" for key, value in document["origin"].items()})
        for axis, values in reversal.items():
            if values.shape != error_map.nodes[axis].shape:
                raise Refusal(
                    f"reversal of {AXES[axis]}: not one value for each node", fault="mismatch"
                )
        verdict = Verdict()
        if origin.verdict:
            # What the map does not hold was judged when it was made.
            verdict = Verdict(origin.verdict.partition(":")[0], "so says the map.")
        return Identified(error_map, reversal, origin, tuple(document["remarks"]), verdict=verdict)
    except KeyError as missing:
        raise Refusal(f"{source}: {missing} is missing", fault="missing") from None
    except (TypeError, AttributeError, ValueError) as error:
        raise Refusal(f"{source}: {error}", **fields_of(error)) from None


def _learned(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a map has beside its curves; maps of earlier versions have nothing there."""
    parts = document.get("learned", ())
    if not parts:
        return {}
    made = tuple(
        LearnedDisplacement(
            part["acts_on"],
            part["shape"],
            float(part["amplitude"]),
            {AXES.index(letter): (low, high) for letter, (low, high) in part["box"].items()},
        )
        for part in parts
    )
    rows = [known_numbers(row) for row in document["learned_covariance"]]
    return {"learned": made, "learned_covariance": np.array(rows)}


def correction_from_file(
    path: Path, limit: float, machine: Machine | None = None
) -> "TargetCorrection":
    """Return the correction of targets by the map in a file.

    Args:
        path: of the file, a document of the schema ``volumetric_map``.
        limit: largest correction of an axis, m.
        machine: that is to be corrected; None: any.

    Raises:
        ValueError: the file cannot be read, is not a map, contains no error, or is of another
            machine.
    """
    from stepdiag_ros.run.target_correction import TargetCorrection

    try:
        data = path.read_bytes()
        text = data.decode("utf-8")
    except OSError as error:
        raise Refusal(
            f"correction: {path} cannot be read: {error.strerror}", fault="unreadable"
        ) from None
    except UnicodeDecodeError:
        raise ValueError(f"correction: {path} is not text file") from None
    identified = map_from_text(text, str(path))
    if not identified.error_map.tells_any_node():
        raise Refusal(
            f"{path}: no error in the box is determined, so no target can be corrected",
            fault="undetermined",
        )
    origin = identified.origin
    if machine is not None:
        _refuse_other(path, "chain", identified.error_map.chain, machine.chain)
        _refuse_other(path, "name", origin.machine, machine.name)
    return TargetCorrection(
        error_map=identified.error_map,
        limit=limit,
        name=path.name,
        sha256=hashlib.sha256(data).hexdigest(),
        made_from=" ".join(part for part in (origin.file, origin.run_id) if part),
    )


def _refuse_other(path: Path, what: str, of_map: str, of_machine: str) -> None:
    if of_map and of_machine and of_map != of_machine:
        raise Refusal(
            f"{path} is of another machine: its {what} is '{of_map}', that of the machine file"
            f" '{of_machine}'; no target is corrected by it",
            fault="mismatch",
            aspect=what,
        )


def _beside_curves(error_map: VolumetricMap) -> str:
    """Say in the table of curves what the map has beside them."""
    if not error_map.learned:
        return ""
    told = f"learned displacements beside these curves: {len(error_map.learned)}, see {MAP}"
    return "".join(f"{line}\n" for line in COMMENT.lines(told))


def _curves(error_map: VolumetricMap) -> str:
    rows = [_CURVES_TITLE]
    for name, curve in error_map.curves.items():
        nodes = error_map.nodes[AXES.index(name[3])]
        spreads = error_map.standard_uncertainty.get(name, np.full(len(nodes), np.nan))
        for node, value, spread in zip(
            nodes.tolist(), curve.tolist(), spreads.tolist(), strict=True
        ):
            if isfinite(value):
                # What the frame fixes is as uncertain as its rounding, not without uncertainty.
                uncertainty = f"{max(spread, ROUNDING):.6e}" if isfinite(spread) else ""
                rows.append(f"{name},{node:.9g},0,{value:.12e},{uncertainty},")
    return "\n".join([*rows, ""])


def _grid(error_map: VolumetricMap) -> str:
    rows = [_GRID_TITLE]
    grid = error_map.grid()
    for place, vector in zip(grid.tolist(), error_map.errors(grid).tolist(), strict=True):
        told = [f"{value:.6e}" if isfinite(value) else "" for value in vector]
        rows.append(",".join([*(f"{value:.9g}" for value in place), *told]))
    return "\n".join([*rows, ""])


CONTROL = _Generic()
