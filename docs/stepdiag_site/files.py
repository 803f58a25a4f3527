"""The reference of the files that users write: those that come with the package, with comments."""

from pathlib import Path

from stepdiag_site.sources import ROOT


def files(folder: str) -> list[Path]:
    """Return the YAML files of a folder below ``config``."""
    return sorted((ROOT / "config" / folder).glob("*.yaml"))


def files_page(folders: str) -> str:
    """Return the text of every YAML file of some folders below ``config``.

    Args:
        folders: names, separated by spaces.
    """
    return "\n".join(
        f"## {folder}/{path.name}\n\n```yaml\n{path.read_text(encoding='utf-8')}```\n"
        for folder in folders.split()
        for path in files(folder)
    )
