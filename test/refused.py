"""What a test may ask of an error: its class, its fields, and the names and numbers that it says.

Sentences are for people, and are reworded without asking anybody. That a sentence names the file,
the parameter or the value that is wrong is no matter of wording: a user cannot mend what is not
named.
"""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import pytest

PROSE = re.compile(r"[A-Za-z]{2,} +[A-Za-z]{2,}")
"""Two words in a row, which is wording."""


SHOWN = ("about", "where", "row")
"""Fields that users must see, since they can mend only what is named."""


class AFault(NamedTuple):
    """What an error must tell; see ``refused``."""

    fault: str | None
    names: tuple[str, ...]
    fields: tuple[tuple[str, Any], ...]


def a_fault(fault: str | None = None, *names: str, **fields: Any) -> AFault:
    """Return what an error must tell, for a list of parameters."""
    return AFault(fault, names, tuple(fields.items()))


@contextmanager
def refused(
    error: type[BaseException] | tuple[type[BaseException], ...],
    fault: str | AFault | None = None,
    *names: str,
    **fields: Any,
) -> Iterator[pytest.ExceptionInfo[BaseException]]:
    """Demand that what is in the block ends with an error.

    Args:
        error: its class, or several.
        fault: its kind (``stepdiag_ros.metrology.refusal.Fault``), or all that it must tell; None
            where the class says all, or the error is not one of ours.
        names: identifiers, numbers and files that stand in its text, each as a whole.
        fields: of the error, with their values: ``about``, ``where`` and ``row``, which must
            stand in its text too, or ``errno`` and others.
    """
    told = fault if isinstance(fault, AFault) else a_fault(fault, *names, **fields)
    with pytest.raises(error) as caught:
        yield caught
    if told.fault is not None:
        assert getattr(caught.value, "fault", None) == told.fault, repr(caught.value)
    for field, value in told.fields:
        assert getattr(caught.value, field) == value, repr(caught.value)
    for name in told.names:
        assert not PROSE.search(name), f"'{name}' is wording, no name"
    shown = [str(value) for field, value in told.fields if field in SHOWN]
    names_all(caught.value, *told.names, *shown)


def names_all(error: BaseException, *names: str) -> None:
    """Demand that names and numbers stand in the text of an error, each as a whole."""
    for name in names:
        before = r"(?<!\w)" if re.match(r"\w", name) else ""
        behind = r"(?!\w)" if re.search(r"\w$", name) else ""
        found = re.search(f"{before}{re.escape(name)}{behind}", str(error))
        assert found, f"'{name}' is not named: {error}"
