"""Types that the fields of documents share, and how a field says what it means.

A document is made of dataclasses. Each field is declared once, with its type, bounds and meaning:
documents are built through these classes, and their schemas are generated from them. What may be
left out is ``UNSET`` unless it is given.
"""

from collections.abc import Sequence
from dataclasses import MISSING, fields
from typing import Annotated, Any, TypeVar, cast

from msgspec import Meta

from stepdiag_ros.schemas import identifier

Part = TypeVar("Part")
Number = float | None
"""Unknown is NaN in Python, ``null`` in the document."""
Uncertainty = Annotated[float, Meta(ge=0)] | None
Chance = Annotated[float, Meta(ge=0, le=1)] | None
Count = Annotated[int, Meta(ge=0)]
Numbers = Sequence[Number]
Words = Sequence[str]
Text = Annotated[str, Meta(min_length=1)] | None
"""Of what has a name or a place, never empty."""


def means(text: str) -> Meta:
    """Return the meaning of a field, with its unit."""
    return Meta(description=text)


def document_of(name: str, part: str = "") -> Meta:
    """Return the rule that a field is a document of its own.

    Args:
        name: of its schema.
        part: of that document alone, as a JSON pointer into its schema.
    """
    return Meta(extra_json_schema={"$ref": identifier(name) + part})


def one_of(*values: str | float) -> Meta:
    """Return the rule that a field has one of these values."""
    return Meta(extra_json_schema={"enum": list(values)})


def part_of(kind: type[Part], source: object, /, **given: Any) -> Part:
    """Return a part of a document, made from the attributes of a result that have its names.

    Args:
        kind: its class; fields that may be left out are left out unless they are given.
        source: the result.
        given: fields that the result has under no such name, or not in that form.

    Raises:
        AttributeError: a field is neither given nor an attribute of the result.
    """
    taken = {
        one.name: getattr(source, one.name)
        for one in fields(cast(Any, kind))
        if one.name not in given and one.default is MISSING
    }
    return kind(**taken, **given)
