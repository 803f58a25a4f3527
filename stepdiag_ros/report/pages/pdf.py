"""A page as PDF."""

import ctypes.util
import logging
import struct
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

from stepdiag_ros.report.pages.pictures import Drawn

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_CHUNK = struct.Struct(">I4s")
"""Begin of a part of a PNG: its size in bytes, and its kind."""
_CHECKSUM = 4
"""Bytes after each part."""


def get_ready() -> None:
    """Import what makes PDF, which takes some tenths of a second.

    Raises:
        ValueError: the program cannot make PDF here; one sentence says what is missing.
    """
    try:
        with _without_compilers():
            import weasyprint  # noqa: F401
    except (ImportError, OSError) as error:
        raise ValueError(
            f"PDF cannot be made here ({error}): install weasyprint and the system's Pango"
            " (Debian: libpango-1.0-0 libpangoft2-1.0-0 libharfbuzz-subset0), or ask for --html"
        ) from None


def _found_nowhere(name: str) -> str | None:
    del name
    return None


@contextmanager
def _without_compilers() -> Iterator[None]:
    """Load libraries by the names that they have on Linux alone.

    WeasyPrint tries the names of other systems first. For each that is not there, Python starts
    ldconfig, gcc and ld: 54 processes.
    """
    before = ctypes.util.find_library
    if sys.platform == "linux":
        ctypes.util.find_library = _found_nowhere
    try:
        yield
    finally:
        ctypes.util.find_library = before


def pdf_of(html: str, pictures: Iterable[Drawn] = ()) -> bytes:
    """Return a page that was made for print as a PDF document with an outline of its headings.

    Pages are laid out by the sizes of the pictures, which are fetched at the end.

    Args:
        html: of ``page.page(..., for_print=True)``; whatever it would load from elsewhere is left
            out.
        pictures: of the page.

    Raises:
        ValueError: the program cannot make PDF here; one sentence says what is missing.
        OSError: the process that draws the pictures has ended.
    """
    get_ready()
    from weasyprint import HTML
    from weasyprint.urls import URLFetcher

    # A font that lacks a property is no news to whoever waits for a report.
    for name in ("weasyprint", "fontTools"):
        logging.getLogger(name).setLevel(logging.ERROR)
    # Pictures are found in the cache by their addresses, and nothing is loaded from elsewhere.
    nowhere = URLFetcher(allowed_protocols=("data",), fail_on_errors=True)
    made: bytes = HTML(string=html, url_fetcher=nowhere).write_pdf(
        cache={one.address: _placed(one) for one in pictures if one.address}
    )
    return made


def _placed(picture: Drawn) -> Any:
    """Return a picture that WeasyPrint places in a page.

    PDF packs pixels as PNG does. WeasyPrint unpacks every picture and packs it again, a quarter of
    the time that a PDF takes; here a picture goes into the document as it was packed.
    """
    import pydyf
    from weasyprint.images import RasterImage

    class Packed(RasterImage):  # type: ignore[misc]
        def __init__(self) -> None:
            # What RasterImage needs to place it.
            self.id = picture.address
            self.width, self.height = picture.size.dots
            self.ratio = self.width / self.height
            self._dpi = None

        def get_x_object(self, interpolate: bool, _: float) -> Any:
            content = {
                "Type": "/XObject",
                "Subtype": "/Image",
                "Width": self.width,
                "Height": self.height,
                "ColorSpace": "/DeviceRGB",
                "BitsPerComponent": 8,
                "Interpolate": "true" if interpolate else "false",
                "Filter": "/FlateDecode",
                "DecodeParms": pydyf.Dictionary(
                    {"Predictor": 15, "Columns": self.width, "Colors": 3}
                ),
            }
            return pydyf.Stream([packed_pixels(picture.fetch())], pydyf.Dictionary(content))

    return Packed()


def packed_pixels(png: bytes) -> bytes:
    """Return the packed pixels of a PNG: the contents of its IDAT chunks, one after another."""
    pixels, at = [], len(_SIGNATURE)
    while at < len(png):
        size, kind = _CHUNK.unpack_from(png, at)
        at += _CHUNK.size
        if kind == b"IDAT":
            pixels.append(png[at : at + size])
        at += size + _CHECKSUM
    return b"".join(pixels)
