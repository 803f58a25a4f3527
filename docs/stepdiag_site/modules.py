"""The Python reference: public functions and classes with their docstrings, read from the source.

The syntax tree is read, and no module is imported: that takes a fraction of the time, and describes
the modules that need ROS 2 or a device as well.
"""

import ast
import re
from collections.abc import Iterator

from stepdiag_site.sources import PACKAGE, ROOT

SKIPPED = ("commands", "embedded/modules")
"""Folders of which nothing is told here: commands have a page of their own, and the other imitates
the interfaces of others (rclpy and its like), whose documentation holds."""

_SECTIONS = {
    "Args": "param ",
    "Attributes": "var ",
    "Raises": "raises ",
    "Returns": "returns",
    "Yields": "yields",
}
"""Section of a docstring → field of the Python domain that it becomes."""
_SECTION = re.compile(rf"^({'|'.join(_SECTIONS)}):$")
_ITEM = re.compile(r"^(?P<name>[\w.*, ]+?)(?: \([^)]*\))?: (?P<text>.+)$")
_CODE = re.compile(r"``.+?``|`[^`]+`", re.DOTALL)
_MEMBER_FENCE, _CLASS_FENCE = ":::::", "::::::"

Function = ast.FunctionDef | ast.AsyncFunctionDef


def packages() -> list[str]:
    """Return the folders that hold modules, below the package, ``.`` for itself."""
    folders = {path.parent.relative_to(PACKAGE).as_posix() for path in PACKAGE.rglob("*.py")}
    return sorted(
        folder
        for folder in folders
        if not any(folder == skipped or folder.startswith(f"{skipped}/") for skipped in SKIPPED)
    )


def modules_page(folders: str) -> str:
    """Return what is public in the modules of some folders.

    Args:
        folders: below the package, separated by spaces; ``.`` for the package itself. A folder that
            ends in ``/**`` stands for itself and all below it.
    """
    return "\n".join(_folder(folder) for folder in expanded(folders))


def expanded(folders: str) -> list[str]:
    """Return the folders that an argument of ``modules_page`` stands for."""
    known = packages()
    found: list[str] = []
    for folder in folders.split():
        top = folder.removesuffix("/**")
        below = folder.endswith("/**")
        found += [one for one in known if one == top or (below and one.startswith(f"{top}/"))]
    return found


def _folder(folder: str) -> str:
    parts = []
    for path in sorted((PACKAGE / folder).glob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        names = path.relative_to(ROOT).with_suffix("").parts
        name = ".".join(part for part in names if part != "__init__")
        members = "".join(_Module(name, tree).members())
        about = ast.get_docstring(tree)
        if members or (path.name == "__init__.py" and about):
            text = _markdown(about or "")
            heading = name.removeprefix("stepdiag_ros.")
            parts.append(f"\n## {heading}\n\n```{{py:module}} {name}\n```\n\n{text}\n{members}")
    return "".join(parts)


class _Module:
    """The public members of a module.

    Args:
        name: full name of the module.
        tree: its syntax tree.
    """

    def __init__(self, name: str, tree: ast.Module) -> None:
        self._name = name
        self._tree = tree
        self._full_names = _full_names(name, tree)

    def members(self) -> Iterator[str]:
        """Yield a directive for each public function, class and explained constant."""
        body = self._tree.body
        for statement, following in zip(body, [*body[1:], None], strict=True):
            if isinstance(statement, Function) and _is_public(statement):
                yield self._function(statement, "function", _CLASS_FENCE)
            elif isinstance(statement, ast.ClassDef) and _is_public(statement):
                yield self._class(statement)
            elif isinstance(statement, ast.Assign | ast.AnnAssign):
                yield self._constant(statement, following)

    def _constant(self, statement: ast.Assign | ast.AnnAssign, following: object) -> str:
        target = statement.targets[0] if isinstance(statement, ast.Assign) else statement.target
        explained = isinstance(following, ast.Expr) and isinstance(following.value, ast.Constant)
        if not isinstance(target, ast.Name) or target.id.startswith("_") or not explained:
            return ""
        return self._directive("data", target.id, _markdown(str(following.value.value)))

    def _class(self, statement: ast.ClassDef) -> str:
        text = _markdown(ast.get_docstring(statement) or "")
        bases = [ast.unparse(base) for base in statement.bases]
        if bases:
            text = f"Bases: `{'`, `'.join(bases)}`\n\n{text}"
        for member in statement.body:
            if isinstance(member, Function) and _is_public(member):
                marks = {ast.unparse(mark) for mark in member.decorator_list}
                kind = "property" if marks & {"property", "cached_property"} else "method"
                text += self._function(member, kind, _MEMBER_FENCE)
        return self._directive("class", statement.name, text)

    def _function(self, statement: Function, kind: str, fence: str) -> str:
        text = _markdown(ast.get_docstring(statement) or "")
        if kind == "property":
            return self._directive(kind, statement.name, text, fence)
        arguments = statement.args
        if kind == "method" and arguments.args and arguments.args[0].arg in ("self", "cls"):
            arguments.args = arguments.args[1:]
        signature = f"{statement.name}({self._written(arguments)})"
        if statement.returns is not None:
            signature += f" -> {ast.unparse(self._full(statement.returns))}"
        return self._directive(kind, signature, text, fence)

    def _written(self, arguments: ast.arguments) -> str:
        for node in ast.walk(arguments):
            if isinstance(node, ast.arg) and node.annotation is not None:
                node.annotation = self._full(node.annotation)
        return ast.unparse(arguments).replace("\n", " ")

    def _full(self, annotation: ast.expr) -> ast.expr:
        """Return an annotation with the names of types in full."""
        full: ast.expr = _InFull(self._full_names).visit(annotation)
        return full

    def _directive(self, kind: str, signature: str, text: str, fence: str = _CLASS_FENCE) -> str:
        options = f":module: {self._name}\n" if fence == _CLASS_FENCE else ""
        name = signature.split("(")[0]
        if (ROOT / self._name.replace(".", "/") / f"{name}.py").exists():
            # The name stands for a module already, under which it is found.
            options += ":no-index:\n"
        return f"\n{fence}{{py:{kind}}} {signature}\n{options}\n{text}\n{fence}\n"


class _InFull(ast.NodeTransformer):
    """Writes the names in an annotation in full, so that each is a link to one thing.

    Args:
        full_names: of the names that the module knows.
    """

    def __init__(self, full_names: dict[str, str]) -> None:
        self._full_names = full_names

    def visit_Name(self, node: ast.Name) -> ast.Name:
        """Write a name in full."""
        return ast.Name(self._full_names.get(node.id, node.id))

    def visit_Constant(self, node: ast.Constant) -> ast.expr:
        """Take an annotation in quotation marks for what is in them."""
        if not isinstance(node.value, str):
            return node
        quoted: ast.expr = self.visit(ast.parse(node.value, mode="eval").body)
        return quoted

    def visit_Subscript(self, node: ast.Subscript) -> ast.expr:
        """Leave the values of a Literal as they are."""
        if ast.unparse(node.value) != "Literal":
            self.generic_visit(node)
        return node


def _is_public(statement: Function | ast.ClassDef) -> bool:
    """Say whether a definition is one to be told of: no overload, no setter of a property."""
    marks = [ast.unparse(mark) for mark in statement.decorator_list]
    told = not any(mark == "overload" or mark.endswith(".setter") for mark in marks)
    return told and not statement.name.startswith("_")


def _full_names(module: str, tree: ast.Module) -> dict[str, str]:
    """Return the names that a module imports or defines, with what they are in full."""
    names = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and not node.level:
            for alias in node.names:
                names[alias.asname or alias.name] = f"{node.module}.{alias.name}"
    for statement in tree.body:
        targets = statement.targets if isinstance(statement, ast.Assign) else []
        for name in [getattr(statement, "name", ""), *map(ast.unparse, targets)]:
            names[name] = f"{module}.{name}"
    return names


def _markdown(docstring: str) -> str:
    """Return a docstring in Google's style as Markdown with fields."""
    lines: list[str] = []
    section = ""
    for line in docstring.splitlines():
        found = _SECTION.match(line)
        if found:
            section = found[1]
            lines.append("")
        elif section and line and not line.startswith(" "):
            section = ""
            lines += ["", line]
        elif section:
            lines += _field(section, line, lines)
        else:
            lines.append(re.sub(r"::$", ":", line))
    return _escaped("\n".join(lines))


def _field(section: str, line: str, before: list[str]) -> list[str]:
    field = _SECTIONS[section]
    if not line.strip():
        return [""]
    text = line[4:]
    if field.endswith(" "):
        item = _ITEM.match(text)
        if item:
            name = item["name"].replace("*", r"\*")
            return [f":{field}{name}: {item['text']}"]
    elif not (before and before[-1].startswith((":", " "))):
        return [f":{field}: {text.strip()}"]
    # A field goes on in indented lines.
    return [f"    {text.strip()}"]


def _escaped(text: str) -> str:
    """Return a text in which angle brackets outside of code are no HTML."""
    parts = []
    end = 0
    for code in _CODE.finditer(text):
        parts += [text[end : code.start()].replace("<", r"\<"), code[0]]
        end = code.end()
    return "".join([*parts, text[end:].replace("<", r"\<")])
