"""The page kit: chapters of tables, sentences and pictures as one HTML page without outside files.

The same page is read on a screen and printed. For print (and for the PDF that is made of it) long
tables are left to the page and to the JSON document, and it says so.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from stepdiag_ros import __version__
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.report.pages.pictures import Drawn

MOST_ROWS_IN_PRINT = 30
"""A table of more rows is left out of print."""
MOST_ROWS_TOGETHER = 25
"""A table of no more rows stands on one page of print, beside others if they fit; a longer one may
go on, under its heads."""
_GOOD, _BAD, _OPEN, _NEUTRAL = "good", "bad", "open", "neutral"
_VALUE = re.compile(r"-?[\d.,]+ (?:± [\d.,]+ )?µm\b")
TONES = (_GOOD, _BAD, _OPEN, _NEUTRAL)
"""In which a page may open: good, bad, open (something is to be done), neutral."""


@dataclass(frozen=True)
class Fact:
    """A name and what is known under it; unknown is said in words."""

    name: str
    text: str


@dataclass(frozen=True)
class Chapter:
    """A part of a page.

    Attributes:
        key: identifier in the page, for links.
        title: its heading.
        html: its content, safe HTML as templates make it.
    """

    key: str
    title: str
    html: Markup


@dataclass(frozen=True)
class Lead:
    """What stands on top of a page, for somebody who reads nothing else.

    Attributes:
        tone: one of ``TONES``.
        headline: a few words.
        sentences: what they mean.
        facts: the figures that they rest on.
        worst: the largest error with its uncertainty and place, large below the headline; empty:
            none is known.
    """

    tone: str
    headline: str
    sentences: tuple[str, ...]
    facts: tuple[Fact, ...] = ()
    worst: str = ""


def unbroken(text: str) -> Markup:
    """Return a text as HTML in which no value is torn from its ± or its unit at a line's end."""
    return Markup(_VALUE.sub(r'<span class="value">\g<0></span>', str(escape(text))))


@cache
def environment() -> Environment:
    """Return the templates; whatever is put into them is escaped."""
    made = Environment(
        loader=PackageLoader("stepdiag_ros.report.pages"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters["unbroken"] = unbroken
    made.globals["software_version"] = __version__
    made.globals["most_rows_in_print"] = MOST_ROWS_IN_PRINT
    made.globals["most_rows_together"] = MOST_ROWS_TOGETHER
    return made


def chapter(
    key: str,
    title: str,
    templates: Sequence[str],
    values: Mapping[str, Any],
    pictures: Mapping[str, Drawn],
    for_print: bool = False,
) -> Chapter:
    """Return a chapter.

    Args:
        key: identifier in the page.
        title: its heading.
        templates: names of files, such as ``sections/curves.html``; the first that is there is
            taken. It begins with ``{% import "parts.html" as parts with context %}``, whose macros
            lay out tables, pictures, facts and sentences.
        values: what the template needs.
        pictures: name → picture; the template's ``pictures``.
        for_print: the template's ``for_print``.
    """
    html = (
        environment()
        .select_template(templates)
        .render(**values, pictures=pictures, for_print=for_print, key=key)
    )
    return Chapter(key, title, Markup(html))


def page(
    title: str,
    subtitle: str,
    lead: Lead,
    chapters: Sequence[Chapter],
    footer: str,
    for_print: bool = False,
    summary: Chapter | None = None,
) -> str:
    """Return a page as HTML text with everything in it.

    Args:
        title: what the page is.
        subtitle: of what.
        lead: what stands on top.
        chapters: numbered in this order.
        footer: identity of the run, at the foot of every printed page.
        for_print: lay it out on pages of paper (A4) alone.
        summary: stands after the lead, before the contents; the chapters are then its annexes.

    Raises:
        ValueError: the lead's tone is none.
    """
    if lead.tone not in TONES:
        raise Refusal(f"there is no tone '{lead.tone}'; use {', '.join(TONES)}", fault="unknown")
    return (
        environment()
        .get_template("page.html")
        .render(
            title=title,
            subtitle=subtitle,
            lead=lead,
            chapters=chapters,
            footer=footer,
            for_print=for_print,
            summary=summary,
        )
    )
