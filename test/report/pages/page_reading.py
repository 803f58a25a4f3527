"""Reads a page of the report back: its headings, tables, pictures and sentences."""

from html.parser import HTMLParser

from stepdiag_ros.report.pages.sections import sections


def sections_without_archive():
    """Return the sections of a page for which no archive was named."""
    return [one for one in sections() if one.name != "history"]


class ReadPage(HTMLParser):
    """What stands in a page.

    Attributes:
        title: of the document.
        headings: texts of h1, h2 and h3 in their order.
        tables: caption → rows of cells, heads first.
        sources: of all pictures.
        links: targets of all links and of everything that is loaded.
        text: everything that is read.
    """

    def __init__(self, html):
        super().__init__()
        self.title, self.headings, self.tables = "", [], {}
        self.sources, self.links, self._parts = [], [], []
        self._open, self._rows, self._caption, self._facts = [], [], "", 0
        self.feed(html)
        self.close()
        self.text = " ".join(" ".join(self._parts).split())

    def handle_starttag(self, tag, attributes):
        given = dict(attributes)
        if tag == "img":
            self.sources.append(given["src"])
        self.links += [value for name, value in attributes if name == "href"]
        if tag in ("link", "script", "iframe", "object"):
            self.links.append(given.get("src") or given.get("href") or tag)
        if tag in ("img", "meta", "br", "link"):
            return
        self._open.append(tag)
        if tag == "table":
            self._rows, self._caption = [], ""
        elif tag == "tr":
            self._rows.append([])
        elif tag in ("td", "th"):
            self._rows[-1].append("")
        elif tag in ("h1", "h2", "h3"):
            self.headings.append("")

    def handle_endtag(self, tag):
        assert self._open.pop() == tag, f"</{tag}> closes something else"
        if tag == "table":
            name = self._caption
            if not name:
                self._facts += 1
                name = f"table {self._facts}"
            assert name not in self.tables, f"two tables are called {name}"
            self.tables[name] = self._rows

    def handle_data(self, data):
        if "style" in self._open:
            return
        self._parts.append(data)
        if "title" in self._open:
            self.title += data
        elif "caption" in self._open:
            self._caption += data
        elif "td" in self._open or "th" in self._open:
            self._rows[-1][-1] += data
        elif {"h1", "h2", "h3"} & set(self._open):
            self.headings[-1] += data

    def facts(self):
        """Return the names and texts of all tables of two columns without a caption."""
        return {
            row[0]: row[1]
            for name, rows in self.tables.items()
            if name.startswith("table ")
            for row in rows
            if len(row) == 2
        }
