"""Figures as files, as bytes and as text."""

import io
import re
from pathlib import Path
from typing import Any

from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from stepdiag_ros.plots.formats import format_of
from stepdiag_ros.plots.style import DOTS_PER_INCH

_GROUP_NAME = re.compile(r'<g id="[^"]*">')
_QUICK = {"compress_level": 3}
"""Of PNG: a tenth larger than the smallest, written in a third of the time."""


def save(figure: Figure, path: Path | str) -> None:
    """Write a figure in the format of the path's ending: png, svg or pdf.

    Raises:
        Refusal: another ending.
        OSError: the file cannot be written.
    """
    path = Path(path)
    path.write_bytes(file_bytes(figure, format_of(path)))


def file_bytes(figure: Figure, picture_format: str) -> bytes:
    """Return a figure as the content of a file: png, svg or pdf."""
    more: dict[str, Any] = {"pil_kwargs": _QUICK} if picture_format == "png" else {}
    stream = io.BytesIO()
    figure.savefig(stream, format=picture_format, **more)
    return stream.getvalue()


def png_bytes(figure: Figure, dpi: float = DOTS_PER_INCH) -> bytes:
    """Return an opaque figure as PNG.

    There is no transparency channel: a PDF would hold a second image of it, packed once more.

    Args:
        figure: with an opaque background.
        dpi: dots per inch.
    """
    before, dots = figure.canvas, figure.dpi
    try:
        figure.dpi = dpi
        canvas: Any = FigureCanvasAgg(figure)
        pixels, size = canvas.print_to_buffer()
    finally:
        figure.dpi = dots
        figure.set_canvas(before)
    stream = io.BytesIO()
    image = Image.frombuffer("RGBA", size, pixels).convert("RGB")
    image.save(stream, format="png", dpi=(dpi, dpi), **_QUICK)
    return stream.getvalue()


def dots_of(figure: Figure, dpi: float = DOTS_PER_INCH) -> tuple[int, int]:
    """Return width and height of the PNG that ``png_bytes`` makes of a figure, dots."""
    dots = figure.dpi
    try:
        figure.dpi = dpi
        width, height = figure.bbox.size
    finally:
        figure.dpi = dots
    return int(width), int(height)


def svg_text(figure: Figure, salt: str = "stepdiag") -> str:
    """Return a figure as one ``<svg>`` element for a page; the same figure gives the same text.

    Args:
        figure: any.
        salt: makes the identities in it others than those of a further figure on the same page.
    """
    stream = io.StringIO()
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": salt}):
        figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None})
    text = stream.getvalue()
    # Names of groups are the same in every figure, and nothing refers to them.
    return _GROUP_NAME.sub("<g>", text[text.index("<svg") :])
