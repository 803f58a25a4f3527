"""A page as PDF."""

import logging


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
    # Nothing is loaded from elsewhere: a page has everything in itself.
    fetcher = URLFetcher(allowed_protocols=("data",), fail_on_errors=True)
    made: bytes = HTML(string=html, url_fetcher=fetcher).write_pdf()
    return made
