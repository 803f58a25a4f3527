"""A page as PDF."""

import logging
import re
from base64 import b64decode
from collections.abc import Mapping
from typing import Any

_EMBEDDED = re.compile("data:image/png;base64,([A-Za-z0-9+/=]+)")


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

    # A font that lacks a property is no news to whoever waits for a report.
    for name in ("weasyprint", "fontTools"):
        logging.getLogger(name).setLevel(logging.ERROR)
    page, pictures = _pictures_apart(html)
    made: bytes = HTML(string=page, url_fetcher=_fetcher(pictures)).write_pdf()
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


def _fetcher(pictures: Mapping[str, bytes]) -> Any:
    """Return what gives WeasyPrint pictures by their addresses, and nothing from elsewhere."""
    from weasyprint.urls import URLFetcher, URLFetcherResponse

    class Pictures(URLFetcher):  # type: ignore[misc]
        def fetch(self, url: str, headers: Any = None) -> Any:
            if url in pictures:
                return URLFetcherResponse(url, pictures[url], {"Content-Type": "image/png"})
            return super().fetch(url, headers)

    return Pictures(allowed_protocols=("data",), fail_on_errors=True)
