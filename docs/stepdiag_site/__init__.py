"""What the site takes out of the sources: a Sphinx extension that fills pages as they are read.

A line ``<!-- made: KIND ARGUMENT -->`` in a page of ``docs/reference`` is replaced by what
``MAKERS[KIND](ARGUMENT)`` returns, which is Markdown. The line below it is replaced too: it says
where that content is for those who read the page in the tree. Nothing is written into the tree, and
nothing of the package is imported to describe its modules.
"""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.addnodes import pending_xref

from stepdiag_site.command_line import commands_page
from stepdiag_site.documents import documents_page
from stepdiag_site.files import files_page
from stepdiag_site.interfaces import interfaces_page
from stepdiag_site.modules import modules_page
from stepdiag_site.sources import DOCS

MAKERS: dict[str, Callable[[str], str]] = {
    "commands": commands_page,
    "documents": documents_page,
    "files": files_page,
    "interfaces": interfaces_page,
    "modules": modules_page,
}
"""Kind of a page → what makes its text from the words after the kind."""

MARK = re.compile(r"^<!-- made: (?P<kind>\w+) ?(?P<argument>.*?) -->(?:\n.+)?$", re.MULTILINE)
_LINK = re.compile(r"\[(?P<text>[^\]\n]+)\]\((?P<target>[^)#:\s]+)\)")


def filled(text: str) -> str:
    """Return the text of a page with everything in it that is made.

    Raises:
        KeyError: a mark names a kind that there is not.
    """
    return MARK.sub(lambda found: MAKERS[found["kind"]](found["argument"]), text)


def links_for_the_site(text: str, page: Path) -> str:
    """Return the text of a page with links to folders as plain text.

    The pages are read in the tree too, where a folder can be opened; a site has no page for it. A
    link to a page that is not of the site, such as CONTRIBUTING, gives the file itself.

    Args:
        text: Markdown.
        page: file of the page, from whose place links count.
    """

    def plain(found: "re.Match[str]") -> str:
        target = (page.parent / found["target"]).resolve()
        if target.is_dir():
            return found["text"]
        outside = target.suffix == ".md" and not target.is_relative_to(DOCS)
        text = found["text"].replace("`", "")
        return f"{{download}}`{text} <{found['target']}>`" if outside else found[0]

    return _LINK.sub(plain, text)


def _read(app: Any, page: str, source: list[str]) -> None:
    path = Path(app.env.doc2path(page))
    source[0] = links_for_the_site(filled(source[0]), path)


def _exact(_: Any, doctree: nodes.document) -> None:
    """Have each reference to a type looked up by its full name.

    Types are written in full in ``modules``. Sphinx would look through all names for one that ends
    in the same word, which takes a fifth of the time of a build, and finds namesakes.
    """
    for reference in doctree.findall(pending_xref):
        if reference.get("refdomain") == "py":
            reference.attributes.pop("refspecific", None)


def setup(app: Any) -> dict[str, Any]:
    """Connect the extension to Sphinx."""
    app.connect("source-read", _read)
    app.connect("doctree-read", _exact)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
