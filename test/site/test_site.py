"""The site: built without a warning, every link leads somewhere, nothing is missing on it."""

import ast
import html
import re
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

from stepdiag_ros import schemas
from stepdiag_ros.parameters.nodes import NODES

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
WRITTEN = re.compile(r"<text[^>]*>([^<]*)</text>")
"""The words in a drawing."""
LOADED = {("script", "src"), ("img", "src"), ("link", "href"), ("iframe", "src")}


class Page(HTMLParser):
    """What a page links to, what it loads, and its anchors."""

    def __init__(self, text):
        super().__init__()
        self.links, self.loaded, self.anchors = [], [], set()
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        for name, value in attributes:
            if name == "id" or (tag == "a" and name == "name"):
                self.anchors.add(value)
            if (tag, name) == ("a", "href"):
                self.links.append(value)
            if (tag, name) in LOADED:
                self.loaded.append(value)


def pages(site):
    return {path: Page(path.read_text(encoding="utf-8")) for path in site.rglob("*.html")}


def words_of(site, page):
    text = (site / page).read_text(encoding="utf-8")
    return html.unescape(re.sub(r"<[^>]+>", "", text))


def test_the_site_is_built_without_a_warning(build):
    _, done = build
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stderr == ""


def test_every_link_within_the_site_leads_somewhere(site):
    found = pages(site)
    assert len(found) > 50
    for path, page in found.items():
        for link in page.links:
            split = urlsplit(link)
            if split.scheme or link in ("", "#"):
                continue
            target = (path.parent / unquote(split.path)).resolve() if split.path else path
            assert target.exists(), f"{path.name}: {link}"
            if split.fragment and target in found:
                anchors = found[target].anchors
                assert unquote(split.fragment) in anchors, f"{path.name}: {link}"


def test_a_page_that_is_not_of_the_site_is_there_as_a_file(site):
    links = pages(site)[site / "index.html"].links
    (link,) = (one for one in links if one.endswith("/CONTRIBUTING.md"))
    assert (site / link).is_file()


def test_nothing_is_loaded_from_elsewhere(site):
    loaded = [(path.name, what) for path, page in pages(site).items() for what in page.loaded]
    assert loaded
    assert not [what for what in loaded if urlsplit(what[1]).netloc]
    styles = "".join(path.read_text(encoding="utf-8") for path in site.rglob("*.css"))
    assert not re.findall(r"url\(\s*['\"]?(?:https?:)?//", styles)


def test_every_command_is_on_its_page_with_its_options(site):
    from stepdiag_site.command_line import parsers

    text = words_of(site, "reference/commands.html")
    names = [name for name, _, _ in parsers()]
    assert {"demo", "by-hand", "compensate-nc", "tracker locate", "changes"} <= set(names)
    for name, _, parser in parsers():
        assert f"usage: stepdiag {name} " in text, name
        for action in parser._actions:
            for option in action.option_strings:
                assert option in text, f"{name} {option}"


def test_every_message_is_on_its_page_with_every_field(site):
    text = words_of(site, "reference/messages.html")
    interfaces = [*ROOT.glob("msg/*.msg"), *ROOT.glob("srv/*.srv"), *ROOT.glob("action/*.action")]
    assert len(interfaces) >= 15
    for path in interfaces:
        assert f"stepdiag_ros/{path.suffix[1:]}/{path.stem}\n" in text, path.name
        for line in path.read_text(encoding="utf-8").splitlines():
            if line and not line.startswith(("#", "---")):
                kind, name, *_ = line.split()
                comment = line.partition("#")[2].strip()
                for what in (kind, name, comment):
                    assert what in text, f"{path.name}: {what}"


def test_every_parameter_is_on_its_page(site):
    text = words_of(site, "parameters.html")
    for node in NODES:
        for declaration in node.parameters:
            assert declaration.name in text, f"{node.name}: {declaration.name}"
            assert declaration.description in text, f"{node.name}: {declaration.name}"


def test_every_json_document_is_on_its_page_with_every_field(site):
    text = words_of(site, "reference/documents.html")
    for name in schemas.VERSIONS:
        assert f"stepdiag schema {name}\n" in text, name
        for field, about in schemas.schema(name)["properties"].items():
            assert field in text, f"{name}: {field}"
            meaning = about.get("description", "").replace("`", "")
            assert meaning in text, f"{name}: {field}"


def test_every_public_module_is_on_a_page(site):
    from stepdiag_site.modules import expanded, packages

    told = "".join(path.read_text() for path in DOCS.glob("reference/python/*.md"))
    marks = re.findall(r"<!-- made: modules (.*) -->", told)
    folders = [folder for mark in marks for folder in expanded(mark)]
    assert sorted(folders) == packages(), "each folder on one page of docs/reference/python"
    text = "".join(words_of(site, page) for page in site.glob("reference/python/*.html"))
    for folder in packages():
        for path in (ROOT / "stepdiag_ros" / folder).glob("*.py"):
            for statement in ast.parse(path.read_text()).body:
                if isinstance(statement, ast.FunctionDef | ast.ClassDef):
                    private = statement.name.startswith("_")
                    assert private or statement.name in text, f"{path}: {statement.name}"


def test_every_drawing_says_what_is_drawn_now_and_is_explained(tmp_path):
    drawings = {path.name: path for path in DOCS.glob("drawings/*.svg")}
    text = "".join(path.read_text() for path in DOCS.glob("explanation/*.md"))
    assert drawings.keys() == set(re.findall(r"drawings/(\w+\.svg)", text))
    sys.path.append(str(DOCS / "drawings"))
    import draw

    draw.main(tmp_path)
    for name, path in drawings.items():
        now = (tmp_path / name).read_text()
        assert WRITTEN.findall(path.read_text()) == WRITTEN.findall(now), f"{name}: draw it anew"
        assert len(WRITTEN.findall(now)) >= 5
