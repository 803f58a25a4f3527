"""Another package, installed: a distribution of its own in a folder on the path of a process."""

import os
import subprocess
import sys
from pathlib import Path

from patience import PATIENCE

ROOT = Path(__file__).parents[2]


def install(folder, name, modules, entry_points, version="1.0"):
    """Install modules, and the record of the distribution that they are of.

    Args:
        folder: that is to be on the path.
        name: of the distribution.
        modules: name → text.
        entry_points: group → name → object.
        version: of the distribution.
    """
    for module, text in modules.items():
        (folder / f"{module}.py").write_text(text, encoding="utf-8")
    record = folder / f"{name.replace('-', '_')}-{version}.dist-info"
    record.mkdir()
    (record / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
    points = "".join(
        f"[{group}]\n" + "".join(f"{key} = {value}\n" for key, value in entries.items())
        for group, entries in entry_points.items()
    )
    (record / "entry_points.txt").write_text(points)


def python(*arguments, site=None):
    """Run Python in a process of its own, with or without the other package on its path."""
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    environment["PYTHONPATH"] = os.pathsep.join(str(part) for part in (site, ROOT) if part)
    return subprocess.run(
        [sys.executable, *map(str, arguments)],
        capture_output=True,
        text=True,
        env=environment,
        timeout=PATIENCE,
    )


def stepdiag(*arguments, site=None):
    """Run a command likewise."""
    return python("-m", "stepdiag_ros.cli", *arguments, site=site)
