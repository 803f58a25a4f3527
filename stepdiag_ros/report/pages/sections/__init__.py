"""The sections of the report: one module each, which holds it as ``SECTION``.

Another package adds one by an entry point; ``docs/report.md`` has an example.
"""

from functools import cache

from stepdiag_ros.metrology.registry import of_modules, record_fault, with_added
from stepdiag_ros.report.pages.section import ReportSection

ENTRY_POINTS = "stepdiag_ros.sections"
"""Group of entry points by which another package adds sections; each names a ``ReportSection``."""


@cache
def sections() -> tuple[ReportSection, ...]:
    """Return all sections, of this package and of others, in the order of the page.

    Raises:
        ValueError: an entry point cannot be loaded, is no section, or takes a name that is there;
            says which and of which package.
    """
    found = with_added(of_modules(__name__, "SECTION"), ENTRY_POINTS, "section", _fault)
    return tuple(sorted(found.values(), key=lambda one: (one.about_software, one.order)))


def _fault(section: object) -> str:
    return record_fault(section, ReportSection, ("title",))
