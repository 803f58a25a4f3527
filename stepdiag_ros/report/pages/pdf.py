"""A page as PDF."""

import logging
import re
import struct
from base64 import b64decode
from io import BytesIO
from typing import Any

from PIL import Image

_EMBEDDED = re.compile("data:image/png;base64,([A-Za-z0-9+/=]+)")
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
        import weasyprint  # noqa: F401
    except (ImportError, OSError) as error:
        raise ValueError(
            f"PDF cannot be made here ({error}): install weasyprint and the system's Pango"
            " (Debian: libpango-1.0-0 libpangoft2-1.0-0 libharfbuzz-subset0), or ask for --html"
        ) from None


def pdf_of(html: str) -> bytes:
    """Return a page that was made for print as a PDF document with an outline of its headings.

    Args:
        html: of ``page.page(..., for_print=True)``; whatever it would load from elsewhere is left
            out.

    Raises:
        ValueError: the program cannot make PDF here; one sentence says what is missing.
    """
    get_ready()
    from weasyprint import HTML
    from weasyprint.urls import URLFetcher

    # A font that lacks a property is no news to whoever waits for a report.
    for name in ("weasyprint", "fontTools"):
        logging.getLogger(name).setLevel(logging.ERROR)
    page, pictures = _pictures_apart(html)
    # Pictures are found in the cache by their addresses, and nothing is loaded from elsewhere.
    nowhere = URLFetcher(allowed_protocols=("data",), fail_on_errors=True)
    made: bytes = HTML(string=page, url_fetcher=nowhere).write_pdf(
        cache={address: _placed(address, png) for address, png in pictures.items()}
    )
    return made


def _pictures_apart(html: str) -> tuple[str, dict[str, bytes]]:
    """Return a page with a short address for each embedded picture, and address → PNG.

    Nearly all of a page is its pictures, and WeasyPrint reads each address letter by letter.
    """
    pictures: dict[str, bytes] = {}

    def named(found: re.Match[str]) -> str:
        address = f"picture:{len(pictures)}"
        pictures[address] = b64decode(found[1])
        return address

    return _EMBEDDED.sub(named, html), pictures


def _placed(address: str, png: bytes) -> Any:
    """Return a picture that WeasyPrint places in a page.

    PDF packs pixels as PNG does. WeasyPrint unpacks every picture and packs it again, a quarter of
    the time that a PDF takes; here a picture goes into the document as it was packed.
    """
    import pydyf
    from weasyprint.images import RasterImage

    class Packed(RasterImage):  # type: ignore[misc]
        def get_x_object(self, interpolate: bool, dpi_ratio: float) -> Any:
            if self.mode != "RGB" or dpi_ratio != 1:
                return super().get_x_object(interpolate, dpi_ratio)
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
            return pydyf.Stream([packed_pixels(png)], pydyf.Dictionary(content))

    return Packed(Image.open(BytesIO(png)), address, png)


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
