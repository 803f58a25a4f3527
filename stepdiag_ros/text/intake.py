"""How much of a text or a file from outside is taken in: limits of length, depth and number.

All code that reads input from others (bags, plans, machines, pages, peers) uses these functions. A
text within its length may still nest a thousand deep, or name one list a million times over by
references. What is beyond a limit is refused in a sentence before anything is made of it.
"""

import json
import re
from collections.abc import Hashable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml

from stepdiag_ros.metrology.refusal import Refusal, fields_of

LONGEST_TEXT = 1_000_000
"""Characters of a YAML text; plans and machines have some thousand."""
DEEPEST = 50
"""Levels of lists and tables in one another."""
MOST_VALUES = 20_000
"""Values in a YAML text, each counted as often as it is referred to."""
LONGEST_NUMBER = 400
"""Characters of a number in a YAML text; the time to read one grows with their square."""
LARGEST_CHUNK = 32 * 2**20
"""Bytes of messages in a chunk of a bag, decompressed. Recorders make chunks of at most some MB."""
MOST_EXPANSION = 50
"""Times the size of a bag that its chunks may have, decompressed, beyond one largest chunk."""

_NUMBERS = ("tag:yaml.org,2002:int", "tag:yaml.org,2002:float")
_HALVES = re.compile("[\ud800-\udfff]")
_STRING = re.compile(r'"(?:[^"\\]|\\.)*"')


class _BoundedLoader(yaml.SafeLoader):
    """The safe loader; refuses what is too deep, too much, refers to itself, or has a key twice."""

    def __init__(self, stream: str) -> None:
        super().__init__(stream)
        self._measured: dict[int, tuple[int, int]] = {}
        self._depth, self._count = 0, 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        """Compose a node, and keep how deep it is and how many values are in it."""
        event = self.peek_event()  # type: ignore[no-untyped-call]
        mark = event.start_mark
        self._depth += 1
        self._count += 1
        self._bound(self._depth, self._count, mark)
        node: yaml.Node | None = super().compose_node(parent, index)
        self._depth -= 1
        if node is None:
            return None
        if isinstance(node, yaml.ScalarNode):
            _check_scalar(node)
        if isinstance(event, yaml.AliasEvent):
            if id(node) not in self._measured:
                raise _refusal("a list or table that contains itself", mark)
        else:
            self._measured[id(node)] = self._measure(node, mark)
        return node

    def _measure(self, node: yaml.Node, mark: yaml.Mark) -> tuple[int, int]:
        """Return how deep a node is and how many values are in it, references followed."""
        parts: list[yaml.Node] = []
        if isinstance(node, yaml.SequenceNode):
            parts = node.value
        elif isinstance(node, yaml.MappingNode):
            parts = [one for pair in node.value for one in pair]
        known = [self._measured[id(part)] for part in parts]
        depth = 1 + max((one[0] for one in known), default=0)
        values = 1 + sum(one[1] for one in known)
        self._bound(depth, values, mark)
        return depth, values

    def _bound(self, depth: int, values: int, mark: yaml.Mark) -> None:
        if depth > DEEPEST:
            raise _refusal(f"nested more than {DEEPEST} deep", mark)
        if values > MOST_VALUES:
            raise _refusal(f"more than {MOST_VALUES} values", mark)

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        """Make the value of a node; one that is not what its tag or its form says is refused."""
        try:
            return super().construct_object(node, deep=deep)
        except (ValueError, ArithmeticError, LookupError, AttributeError, TypeError):
            kind = node.tag.rpartition(":")[2]
            raise _refusal(f"{str(node.value)[:60]!r} is no {kind}", node.start_mark) from None

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        """Make a table; a key given twice is refused instead of one being lost."""
        seen: set[Hashable] = set()
        for key_node, _ in node.value if isinstance(node, yaml.MappingNode) else ():
            key = self.construct_object(key_node, deep=True)
            if isinstance(key, Hashable):
                if key in seen:
                    raise _refusal(f"the key '{key}' appears twice", key_node.start_mark)
                seen.add(key)
        return super().construct_mapping(node, deep=deep)


def _check_scalar(node: yaml.ScalarNode) -> None:
    if node.tag in _NUMBERS and len(node.value) > LONGEST_NUMBER:
        raise _refusal(f"a number of more than {LONGEST_NUMBER} characters", node.start_mark)
    if not node.value.isascii() and _HALVES.search(node.value):
        raise _refusal("half of a UTF-16 character, which is not text", node.start_mark)


def _refusal(problem: str, mark: yaml.Mark) -> yaml.MarkedYAMLError:
    return yaml.constructor.ConstructorError(None, None, problem, mark)


def parse_yaml(text: str, source: str) -> Any:
    """Parse a YAML text.

    Args:
        text: the YAML.
        source: what the user calls it, usually the file; named in errors.

    Raises:
        ValueError: not YAML, beyond a limit of this module, or a key appears twice; names the
            source and the line.
    """
    if len(text) > LONGEST_TEXT:
        raise Refusal(
            f"{source}: longer than {LONGEST_TEXT} characters", fault="too_many", where=source
        )
    try:
        return yaml.load(text, Loader=_BoundedLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = f", line {mark.line + 1}" if mark is not None else ""
        raise Refusal(
            f"{source}{line}: {error.problem or 'not valid YAML'}",
            fault="malformed",
            where=source,
            row=None if mark is None else mark.line + 1,
            aspect="YAML",
        ) from None
    except yaml.YAMLError as error:
        problem = getattr(error, "reason", None) or "not valid YAML"
        raise Refusal(f"{source}: {problem}", fault="malformed", where=source) from None
    except (ValueError, OverflowError) as error:  # a date or a number that there is not
        raise ValueError(f"{source}: {error}") from None


def parse_json(text: str, source: str) -> Any:
    """Parse a JSON text.

    Args:
        text: the JSON.
        source: what the user calls it; named in errors.

    Raises:
        ValueError: no JSON, or nested deeper than ``DEEPEST``; names the source.
    """
    depth = 0
    for bracket in re.findall(r"[\[\]{}]", _STRING.sub("", text)):
        depth += 1 if bracket in "[{" else -1
        if depth > DEEPEST:
            raise Refusal(
                f"{source}: nested more than {DEEPEST} deep", fault="too_many", where=source
            )
    try:
        return json.loads(text)
    except ValueError as error:
        raise Refusal(
            f"{source} is not a JSON document: {error}", fault="malformed", where=source
        ) from None


@contextmanager
def refusals_of(path: Path) -> Iterator[None]:
    """Let every refusal in the block name the file that is to blame.

    Args:
        path: of the file whose content is evaluated in the block.

    Raises:
        ValueError: of the block, with the file in front if it did not name it.
    """
    try:
        yield
    except ValueError as error:
        if path.name in str(error):
            raise
        raise Refusal(f"{path}: {error}", **fields_of(error)) from error
