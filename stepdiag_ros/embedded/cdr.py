"""CDR: turn messages into the bytes on the wire and back, by code generated for each type.

Nested messages are flattened into one function and neighbouring fields of fixed size into one
``struct`` call, which keeps a small message at a few microseconds. Bytes start with the four bytes
of the encapsulation header; little-endian is written, both byte orders are read. What stands behind
the last field is not looked at: on Fast DDS what rclpy has serialised has a tail of whatever was in
memory.
"""

from __future__ import annotations

import struct
import sys
from array import array
from collections.abc import Callable
from typing import Any

from .definitions import DUMMY_MEMBER, PRIMITIVES, Definition, Field, FieldType

Serializer = Callable[[Any], bytes]
Deserializer = Callable[[bytes], Any]

_HEADER_SIZE = 4


class DecodeError(ValueError):
    """Bytes are not a sample of the type they were read as."""


class _Writer:
    """Source text under construction, with what is known of the position's alignment.

    The position is known to be ``rest`` modulo ``modulus``. Fields of fixed size are collected as
    long as their padding is known, then written by one ``struct`` call.
    """

    def __init__(self, head: str, order: str) -> None:
        self.lines = [head]
        self.names: dict[str, Any] = {
            "PAD": [b"\0" * n for n in range(8)],
            "DecodeError": DecodeError,
        }
        self.indent = 1
        self.modulus, self.rest = 8, 0
        self.format, self.items = "", list[str]()
        self.order = order
        self._count = 0

    def name(self, stem: str) -> str:
        self._count += 1
        return f"{stem}{self._count}"

    def constant(self, stem: str, value: Any) -> str:
        name = self.name(stem)
        self.names[name] = value
        return name

    def emit(self, *lines: str) -> None:
        self.lines.extend("  " * self.indent + line for line in lines)

    def fixed(self, item: str, code: str, size: int) -> None:
        """Add a value of ``size`` bytes, which is also its alignment."""
        if size > self.modulus:
            self.align(size)
        padding = -self.rest % size
        self.format += "x" * padding + code
        self.items.append(item)
        self.rest = (self.rest + padding + size) % self.modulus

    def align(self, size: int) -> None:
        """Move the position, of unknown alignment, to a multiple of ``size``."""
        self.flush()
        self.emit_align(size)
        self.modulus, self.rest = size, 0

    def forget(self, modulus: int = 1) -> None:
        """Note that only a multiple of ``modulus`` is known of the position."""
        self.modulus, self.rest = modulus, 0

    def emit_align(self, size: int) -> None:
        raise NotImplementedError

    def flush(self) -> None:
        raise NotImplementedError

    def build(self, name: str) -> Any:
        # The text is made from parsed definitions only, whose names are checked identifiers.
        exec(compile("\n".join(self.lines), f"<cdr {name}>", "exec"), self.names)
        return self.names["run"]


class _Packer(_Writer):
    def emit_align(self, size: int) -> None:
        self.emit(f"b += PAD[{_HEADER_SIZE} - len(b) & {size - 1}]")

    def flush(self) -> None:
        if self.items or self.format:
            pack = self.constant("pack", struct.Struct(self.order + self.format).pack)
            self.emit(f"b += {pack}({', '.join(self.items)})")
            self.format, self.items = "", []


class _Unpacker(_Writer):
    def emit_align(self, size: int) -> None:
        self.emit(f"p += {_HEADER_SIZE} - p & {size - 1}")

    def flush(self) -> None:
        if self.items or self.format:
            layout = struct.Struct(self.order + self.format)
            unpack = self.constant("unpack", layout.unpack_from)
            self.emit(f"{', '.join(self.items)}, = {unpack}(d, p)", f"p += {layout.size}")
            self.format, self.items = "", []


def make_serializer(definition: Definition, find: Callable[[str], Definition]) -> Serializer:
    """Return the function that turns a message of this type into little-endian CDR."""
    out = _Packer("def run(m):", "<")
    out.emit("b = bytearray(b'\\0\\1\\0\\0')")
    _pack_message(out, "m", definition, find)
    out.flush()
    out.emit("return bytes(b)")
    function: Serializer = out.build(definition.name)
    return function


def _pack_message(
    out: _Packer, owner: str, definition: Definition, find: Callable[[str], Definition]
) -> None:
    for field in definition.wire_fields:
        kind = field.type
        value = f"{owner}._{field.name}" if field.name != DUMMY_MEMBER else "0"
        if not kind.array:
            _pack_single(out, value, kind, find)
            continue
        array_name = out.name("a")
        out.emit(f"{array_name} = {value}")
        if kind.array == "fixed":
            out.emit(
                f"if len({array_name}) != {kind.size}:",
                f"  raise ValueError('{field.name} must have {kind.size} elements.')",
            )
        else:
            out.fixed(f"len({array_name})", "I", 4)
        out.flush()
        _pack_elements(out, array_name, kind, find)


def _pack_single(
    out: _Packer, value: str, kind: FieldType, find: Callable[[str], Definition]
) -> None:
    if kind.name == "string":
        text = out.name("s")
        out.emit(f"{text} = {value}.encode()")
        out.fixed(f"len({text}) + 1", "I", 4)
        out.flush()
        out.emit(f"b += {text}", "b.append(0)")
        out.forget()
    elif kind.is_primitive:
        code, size = PRIMITIVES[kind.name]
        out.fixed(value, "c" if kind.name == "byte" else code, size)
    else:
        nested = out.name("m")
        out.emit(f"{nested} = {value}")
        _pack_message(out, nested, find(kind.name), find)


def _pack_elements(
    out: _Packer, values: str, kind: FieldType, find: Callable[[str], Definition]
) -> None:
    single = FieldType(kind.name, text_bound=kind.text_bound)
    if kind.is_primitive:
        size = PRIMITIVES[kind.name][1]
        whole = {"bool": f"bytes({values})", "byte": f"b''.join({values})"}.get(
            kind.name, f"{values}.tobytes()"
        )
        if size > 1:
            out.emit(f"if len({values}):")
            out.indent += 1
            out.emit_align(size)
            out.indent -= 1
        out.emit(f"b += {whole}")
        out.forget(min(size, 4))
        return
    item = out.name("i")
    out.emit(f"for {item} in {values}:")
    out.indent += 1
    out.forget()
    _pack_single(out, item, single, find)
    out.flush()
    out.indent -= 1
    out.forget()


def make_deserializer(
    definition: Definition,
    find: Callable[[str], Definition],
    message_class: Callable[[str], type],
) -> Deserializer:
    """Return the function that makes a message from CDR with its encapsulation header.

    The function raises :class:`DecodeError` if the bytes cannot be a sample of the type.
    """
    little = _make_reader(definition, find, message_class, "<")
    big: Deserializer | None = None

    def read(data: bytes) -> Any:
        nonlocal big
        try:
            header = data[:2]
            if header == b"\0\1":
                return little(data)
            if header == b"\0\0" and len(data) >= _HEADER_SIZE:
                if big is None:
                    big = _make_reader(definition, find, message_class, ">")
                return big(data)
        except (struct.error, ValueError, MemoryError) as error:
            raise DecodeError(f"{len(data)} bytes are not a {definition.name}: {error}.") from error
        raise DecodeError(f"{len(data)} bytes are not a {definition.name}: no plain CDR header.")

    return read


def _make_reader(
    definition: Definition,
    find: Callable[[str], Definition],
    message_class: Callable[[str], type],
    order: str,
) -> Deserializer:
    out = _Unpacker("def run(d):", order)
    out.names["array"] = array
    out.emit("e = len(d)", f"p = {_HEADER_SIZE}")
    context = _Context(find, message_class)
    root = _unpack_message(out, definition, context)
    out.flush()
    out.emit("if p > e:", "  raise DecodeError('the end is missing')", f"return {root}")
    function: Deserializer = out.build(definition.name)
    return function


class _Context:
    """How to find nested definitions and classes."""

    def __init__(
        self, find: Callable[[str], Definition], message_class: Callable[[str], type]
    ) -> None:
        self.find = find
        self.message_class = message_class


def _unpack_message(out: _Unpacker, definition: Definition, context: _Context) -> str:
    made = context.message_class(definition.name)
    cls, new = out.constant("C", made), out.constant("new", made.__new__)
    owner = out.name("m")
    out.emit(f"{owner} = {new}({cls})")
    for field in definition.wire_fields:
        _unpack_field(out, owner, field, context)
    return owner


def _unpack_field(out: _Unpacker, owner: str, field: Field, context: _Context) -> None:
    kind = field.type
    target = f"{owner}._{field.name}" if field.name != DUMMY_MEMBER else out.name("x")
    if not kind.array:
        _unpack_single(out, target, kind, context)
        return
    count = str(kind.size)
    if kind.array != "fixed":
        count = out.name("n")
        out.fixed(count, "I", 4)
    out.flush()
    _unpack_elements(out, target, count, kind, context)


def _unpack_single(out: _Unpacker, target: str, kind: FieldType, context: _Context) -> None:
    if kind.name == "string":
        count, stop = out.name("n"), out.name("q")
        out.fixed(count, "I", 4)
        out.flush()
        out.emit(
            f"{stop} = p + {count}",
            f"if {stop} > e:",
            "  raise DecodeError('a string is cut off')",
            # rclpy replaces what is not UTF-8 as well.
            f"{target} = d[p:{stop} - 1].decode('utf-8', 'replace') if {count} else ''",
            f"p = {stop}",
        )
        out.forget()
    elif kind.is_primitive:
        code, size = PRIMITIVES[kind.name]
        out.fixed(target, "c" if kind.name == "byte" else code, size)
    else:
        out.emit(f"{target} = {_unpack_message(out, context.find(kind.name), context)}")


def _unpack_elements(
    out: _Unpacker, target: str, count: str, kind: FieldType, context: _Context
) -> None:
    if kind.is_primitive:
        _unpack_primitives(out, target, count, kind)
        return
    values, item = out.name("a"), out.name("i")
    out.emit(
        f"if {count} > e - p:",
        "  raise DecodeError('a sequence is cut off')",
        f"{values} = []",
        f"for _ in range({count}):",
    )
    out.indent += 1
    out.forget()
    _unpack_single(out, item, FieldType(kind.name), context)
    out.flush()
    out.emit(f"{values}.append({item})")
    out.indent -= 1
    out.emit(f"{target} = {values}")
    out.forget()


def _unpack_primitives(out: _Unpacker, target: str, count: str, kind: FieldType) -> None:
    code, size = PRIMITIVES[kind.name]
    stop = out.name("q")
    if size > 1:
        out.emit(f"if {count}:")
        out.indent += 1
        out.emit_align(size)
        out.indent -= 1
    out.emit(
        f"{stop} = p + {count} * {size}",
        f"if {stop} > e:",
        "  raise DecodeError('an array is cut off')",
    )
    if kind.name == "bool":
        out.emit(f"{target} = [v != 0 for v in d[p:{stop}]]")
    elif kind.name == "byte":
        out.emit(f"{target} = [bytes((v,)) for v in d[p:{stop}]]")
    elif kind.array == "fixed":
        import numpy

        dtype = numpy.dtype(code)
        source = out.constant("dtype", dtype.newbyteorder("<" if out.order == "<" else ">"))
        native = out.constant("dtype", dtype)
        reader = out.constant("frombuffer", numpy.frombuffer)
        # A copy, because a view of the sample's bytes could not be written to.
        out.emit(f"{target} = {reader}(d, {source}, {kind.size}, p).astype({native})")
    else:
        values = out.name("a")
        out.emit(f"{values} = array('{code}')", f"{values}.frombytes(d[p:{stop}])")
        if (out.order == "<") != (sys.byteorder == "little"):
            out.emit(f"{values}.byteswap()")
        out.emit(f"{target} = {values}")
    out.emit(f"p = {stop}")
    out.forget(min(size, 4))
