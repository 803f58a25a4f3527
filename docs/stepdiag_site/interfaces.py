"""The reference of messages and actions: what ``ros2 interface show`` prints, as tables."""

import re
from pathlib import Path

from stepdiag_site.sources import ROOT

_FIELD = re.compile(r"(?P<type>\S+)\s+(?P<name>\w+)(?P<value>=\S+)?\s*(?:#\s*(?P<comment>.*))?$")
_PARTS = ("Goal", "Result", "Feedback")


def interfaces() -> list[Path]:
    """Return the files of messages, services and actions of this package."""
    return sorted(
        path for kind in ("msg", "srv", "action") for path in ROOT.glob(f"{kind}/*.{kind}")
    )


def interfaces_page(_: str) -> str:
    """Return every interface with its fields, types, units and meanings."""
    return "\n".join(_interface(path) for path in interfaces())


def _interface(path: Path) -> str:
    kind = path.suffix.removeprefix(".")
    blocks = path.read_text(encoding="utf-8").split("\n---\n")
    text = f"## {path.stem}\n\n`stepdiag_ros/{kind}/{path.stem}`\n\n"
    for count, block in enumerate(blocks):
        about, constants, fields = _read(block)
        text += f"{_escaped(about)}\n\n"
        if len(blocks) > 1:
            text += f"### {path.stem}: {_PARTS[count].lower()}\n\n"
        text += _table(("Constant", "Type", "Meaning"), constants)
        text += _table(("Field", "Type", "Unit and meaning"), fields)
    return text


def _read(block: str) -> tuple[str, list[tuple[str, ...]], list[tuple[str, ...]]]:
    about: list[str] = []
    constants: list[tuple[str, ...]] = []
    fields: list[tuple[str, ...]] = []
    for line in block.splitlines():
        if line.startswith("#"):
            about.append(line.removeprefix("#").strip())
            continue
        found = _FIELD.match(line)
        if found is None:
            about.append("")
            continue
        name, comment = f"`{found['name']}{found['value'] or ''}`", found["comment"] or ""
        rows = constants if found["value"] else fields
        rows.append((name, f"`{found['type']}`", _escaped(comment)))
    return "\n".join(about).strip(), constants, fields


def _table(heading: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    if not rows:
        return ""
    lines = [heading, ("---",) * len(heading), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines) + "\n"


def _escaped(text: str) -> str:
    return text.replace("|", r"\|").replace("<", r"\<").replace("*", r"\*")
