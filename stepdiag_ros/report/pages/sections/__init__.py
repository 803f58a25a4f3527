"""The sections of the report in their order: one module each, which holds it as ``SECTION``.

A new section is a module here, a template of the same name and a line in ``_MODULES``.
"""

from functools import cache
from importlib import import_module

from stepdiag_ros.report.pages.section import ReportSection

_MODULES = (
    "measurement",
    "readings",
    "curves",
    "table_one",
    "squareness",
    "axes",
    "diagonals",
    "volume",
    "uncertainty",
    "visibility",
    "discrepancy",
    "compensation",
    "unknown",
)


@cache
def sections() -> tuple[ReportSection, ...]:
    """Return all sections in the order of the page."""
    return tuple(import_module(f"{__name__}.{name}").SECTION for name in _MODULES)
