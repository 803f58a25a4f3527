"""Texts and tables on a terminal, or in a file that is laid out as one."""

from typing import IO, Any

from rich import box
from rich.console import Console
from rich.table import Table as RichTable
from rich.text import Text

from stepdiag_ros.text.controls import printable
from stepdiag_ros.text.table import Table
from stepdiag_ros.text.terminal import columns, fitted

_LEAST_WIDTH = 150
_EDGES = 2
"""Blanks at the two edges of a table."""


class PlainConsole(Console):
    """A console that leaves it to its user what happens when nobody reads on."""

    text_width: int | None = None
    """At which sentences are broken into lines; None to leave them whole."""

    def print(self, *objects: Any, **options: Any) -> None:
        """Print texts and tables; on a narrow terminal a table is folded."""
        for one in objects or ("",):
            if not isinstance(one, Table):
                super().print(one, **options)
            elif self.text_width is None:
                super().print(_laid_out(one), **options)
            else:
                for part in one.folded(self.text_width - _EDGES):
                    width = max(self.text_width, part.least_width + _EDGES)
                    super().print(_laid_out(part), **{"width": width, **options})

    def sentence(self, text: str, indent: str = "") -> None:
        """Print a text, broken into lines where the terminal is narrow.

        Args:
            text: what is printed.
            indent: of all lines but the first.
        """
        self.print(fitted(text, self.text_width, indent), soft_wrap=True)

    def render_str(self, text: str, **options: Any) -> Text:
        """Take out of a text what would steer a terminal."""
        return super().render_str(printable(text), **options)

    def on_broken_pipe(self) -> None:
        """Let the caller know, as every other stream does."""
        raise BrokenPipeError


def make_console(stream: IO[str]) -> PlainConsole:
    """Return a console for plain text, never so narrow that a number would be cut."""
    console = PlainConsole(file=stream, markup=False, highlight=False, emoji=False)
    console.text_width = columns(stream)
    if not console.is_terminal or console.width < _LEAST_WIDTH:
        console.width = _LEAST_WIDTH
    return console


def _laid_out(table: Table) -> RichTable:
    made = RichTable(
        title=table.title,
        title_justify="left",
        title_style="bold",
        header_style="bold",
        box=box.SIMPLE_HEAD,
        padding=(0, table.gap - 1, 0, 0),
        pad_edge=False,
        min_width=len(table.title) if table.whole_title else None,
    )
    for column in table.columns:
        made.add_column(
            column.header,
            justify="right" if column.number else "left",
            no_wrap=not column.wraps,
            max_width=column.widest,
        )
    for place, row in enumerate(table.rows):
        made.add_row(*row, end_section=place in table.section_ends)
    return made
