"""What a section of the report is: what it tells, what it has drawn, what it writes as JSON."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from stepdiag_ros.report.pages.material import Material
from stepdiag_ros.report.pages.pictures import Drawing


@dataclass(frozen=True)
class SectionContent:
    """What a section tells of one run.

    Attributes:
        values: what its template, ``templates/sections/KEY.html``, is filled with.
        drawings: name → picture that the template places.
    """

    values: Mapping[str, Any]
    drawings: Mapping[str, Drawing] = field(default_factory=dict)


@dataclass(frozen=True)
class ReportSection:
    """A section of the report.

    Attributes:
        key: its name in the page's links, among the templates and in the JSON document.
        title: its heading.
        tell: returns what it tells of a run; a text is the sentence that says why it has nothing
            to tell.
        document: returns its part of the JSON document, None where the run has nothing for it; of a
            section whose figures are in the part of another one it is None itself.
    """

    key: str
    title: str
    tell: Callable[[Material], SectionContent | str]
    document: Callable[[Material], Any] | None = None
