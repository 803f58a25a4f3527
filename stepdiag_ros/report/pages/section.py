"""What a section of the report is: what it tells, what it has drawn, what it writes as JSON."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from stepdiag_ros.report.pages.material import Material
from stepdiag_ros.report.pages.page import Chapter, chapter
from stepdiag_ros.report.pages.pictures import Drawing, Drawn


@dataclass(frozen=True)
class SectionContent:
    """What a section tells of one run.

    Attributes:
        values: what its template is filled with. The template of all sections that have none of
            their own, ``templates/part.html``, takes ``sentences`` (texts), ``tables`` (of
            ``table_views``), and ``folded`` (more of them) under ``folded_title``, and shows all
            pictures.
        drawings: name → picture that the template places.
    """

    values: Mapping[str, Any]
    drawings: Mapping[str, Drawing] = field(default_factory=dict)


@dataclass(frozen=True)
class ToldSection:
    """A section of one run, ready to be drawn and laid out.

    Attributes:
        name: in the page's links, and of the template ``templates/sections/NAME.html`` if there is
            one.
        title: its heading.
        content: what it tells; a text says why it has nothing to tell. With an empty one the page
            leaves it out.
    """

    name: str
    title: str
    content: SectionContent | str

    @property
    def drawings(self) -> Mapping[str, Drawing]:
        """Return its pictures by name."""
        return {} if isinstance(self.content, str) else self.content.drawings

    def chapter(self, pictures: Mapping[str, Drawn], for_print: bool) -> Chapter:
        """Lay it out; ``pictures`` are its own by name."""
        if isinstance(self.content, str):
            templates = ["sections/nothing.html"]
            values: Mapping[str, Any] = {"sentence": self.content}
        else:
            templates = [f"sections/{self.name}.html", "part.html"]
            values = self.content.values
        return chapter(self.name, self.title, templates, values, pictures, for_print)


@dataclass(frozen=True)
class ReportSection:
    """A section of the report: all that is declared of it.

    Attributes:
        name: in the page's links, of its template and of its part of the JSON document.
        title: its heading, also in the list of contents.
        order: its place on the page; those of this package stand at 10, 20, 30 and so on.
        tell: returns what it tells of a run; a text is the sentence that says why it has nothing
            to tell, an empty one that nobody has asked for it.
        document: returns its part of the JSON document, None where the run has nothing for it; of a
            section whose figures are in the part of another one it is None itself.
        about_software: it proves the software, not the machine; the page shows it after all other
            sections, while the JSON document keeps its ``order``.
        by_tracker: it is also on the page of a run with a tracker, if it has something to tell.
    """

    name: str
    title: str
    order: int
    tell: Callable[[Material], SectionContent | str]
    document: Callable[[Material], Any] | None = None
    by_tracker: bool = False
    about_software: bool = False

    def told(self, material: Material) -> ToldSection:
        """Return it with what it tells of a run."""
        return ToldSection(self.name, self.title, self.tell(material))
