"""Pictures for pages: which plot is drawn from what, and the drawing beside other work.

matplotlib takes longer to be imported and to draw than all of the evaluation. So what is to be
drawn is only named here, by the functions of ``stepdiag_ros.plots``, and drawn in a process of its
own while this one goes on. A page can be laid out as soon as the sizes of its pictures are known.
"""

import base64
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache, partial
from typing import TYPE_CHECKING, Any, NamedTuple

from stepdiag_ros.plots.places import WHOLE, Place, printed_at
from stepdiag_ros.report.beside import process_beside, result_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DOTS_PER_INCH = 200
"""Of pictures in pages: sharp in print at the width that they are made for."""


@dataclass(frozen=True)
class Drawing:
    """A picture that is to be drawn.

    Attributes:
        function: name of a function of ``stepdiag_ros.plots``.
        arguments: of the function.
        caption: what it shows, in words.
        keywords: of the function.
        place: where it is printed.
    """

    function: str
    arguments: tuple[Any, ...]
    caption: str
    keywords: Mapping[str, Any] = field(default_factory=dict)
    place: Place = WHOLE


class Size(NamedTuple):
    """Size of a picture: inches at which it is printed at its own size, and dots."""

    width: float
    dots: tuple[int, int]


_NO_SIZE = Size(0.0, (0, 0))


@dataclass(frozen=True)
class Drawn:
    """A picture in a page, which may still be being drawn: its size is known before.

    Attributes:
        caption: what it shows, or why nothing, in words.
        address: names it among the pictures of a page; empty where the plot has nothing to show.
        size: of it.
        share: of the text width of a printed page that it takes.
        fetch: returns it as PNG once it is drawn; raises OSError if the process that draws has
            ended.
    """

    caption: str
    address: str = ""
    size: Size = _NO_SIZE
    share: float = 1.0
    fetch: Callable[[], bytes] = bytes

    @property
    def width(self) -> float:
        """Return the inches at which it is printed at its own size."""
        return self.size.width

    @property
    def source(self) -> str:
        """Return the picture as data URI; empty where the plot has nothing to show."""
        if not self.address:
            return ""
        return f"data:image/png;base64,{base64.b64encode(self.fetch()).decode('ascii')}"


def draw(drawing: Drawing, address: str) -> Drawn | None:
    """Draw a picture in this process when it is fetched; None: it has nothing to show.

    Args:
        drawing: what is drawn.
        address: of the picture.
    """
    figure = _figure_of(drawing)
    if figure is None or isinstance(figure, str):
        return _nothing(figure)
    fetch = cache(partial(_png_of, figure))
    return Drawn(drawing.caption, address, _size_of(figure), drawing.place.share, fetch)


def _nothing(reason: str | None) -> Drawn | None:
    return None if reason is None else Drawn(reason)


def _figure_of(drawing: Drawing) -> "Figure | str | None":
    """Return the figure, why the plot has nothing to show, or None: nothing, without a reason."""
    from stepdiag_ros import plots

    try:
        with printed_at(drawing.place):
            figure: Figure | None = getattr(plots, drawing.function)(
                *drawing.arguments, **drawing.keywords
            )
    except ValueError as error:
        return str(error)
    return figure


def _size_of(figure: "Figure") -> Size:
    from stepdiag_ros import plots

    width = round(float(figure.get_figwidth()), 3)
    return Size(width, plots.dots_of(figure, dpi=DOTS_PER_INCH))


def _png_of(figure: "Figure") -> bytes:
    from stepdiag_ros import plots

    made: bytes = plots.png_bytes(figure, dpi=DOTS_PER_INCH)
    return made


_laid_out: dict[str, "Figure"] = {}
"""Figures of the process that draws which are not drawn yet, by the addresses of the pictures."""


def _lay_out(address: str, drawing: Drawing) -> Size | str | None:
    """Make a figure in the process that draws; return its size, or what ``_figure_of`` does."""
    figure = _figure_of(drawing)
    if figure is None or isinstance(figure, str):
        return figure
    _laid_out[address] = figure
    return _size_of(figure)


def _finish(address: str) -> bytes:
    """Return a figure of the process that draws as PNG."""
    return _png_of(_laid_out.pop(address))


def _get_ready() -> None:
    """Import what drawing needs, while the other process reads and computes."""
    from stepdiag_ros import plots

    for name in plots.__all__:
        getattr(plots, name)


class Studio:
    """Draws pictures in the order in which they are asked for, in a process of its own or here.

    Args:
        pool: the process; None: pictures are drawn here, when they are fetched.
    """

    def __init__(self, pool: ProcessPoolExecutor | None = None) -> None:
        self._pool = pool
        self._asked: dict[tuple[str, str], Drawing] = {}
        self._begun: dict[str, Future[Size | str | None]] = {}

    def ask(self, chapter: str, drawings: Mapping[str, Drawing]) -> None:
        """Ask for the pictures of a chapter.

        Args:
            chapter: its key.
            drawings: name → what is to be drawn.
        """
        for name, drawing in drawings.items():
            self._asked[chapter, name] = drawing
            if self._pool is not None:
                address = _address(chapter, name)
                self._begun[address] = self._pool.submit(_lay_out, address, drawing)

    def fetch_all(self) -> dict[str, dict[str, Drawn]]:
        """Return the pictures that were asked for, by chapter and name, as soon as all have a size.

        Those that have nothing to show are not among them.

        Raises:
            OSError: the process that draws has ended.
        """
        drawn: dict[str, dict[str, Drawn]] = {}
        for (chapter, name), drawing in self._asked.items():
            one = self._drawn(drawing, _address(chapter, name))
            if one is not None:
                drawn.setdefault(chapter, {})[name] = one
        return drawn

    def _drawn(self, drawing: Drawing, address: str) -> Drawn | None:
        if self._pool is None:
            return draw(drawing, address)
        found = result_of(self._begun[address])
        if found is None or isinstance(found, str):
            return _nothing(found)
        png = self._pool.submit(_finish, address)
        return Drawn(drawing.caption, address, found, drawing.place.share, partial(result_of, png))


def _address(chapter: str, name: str) -> str:
    return f"picture:{chapter}.{name}"


@contextmanager
def studio(beside: bool = True) -> Iterator[Studio]:
    """Return a place to have pictures drawn while the block runs.

    Args:
        beside: in a process of its own; False: in this one, when they are fetched.
    """
    if not beside:
        yield Studio()
        return
    with process_beside(_get_ready) as pool:
        yield Studio(pool)
