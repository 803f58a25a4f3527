"""Where the sources of the reference lie."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "stepdiag_ros"
DOCS = ROOT / "docs"
