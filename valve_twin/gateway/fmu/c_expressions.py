# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Expressions of a law in C."""

from __future__ import annotations

import ast
import math
from enum import IntEnum
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np
from numba.core.dispatcher import Dispatcher

from valve_twin.gateway.fmu.c_kinds import (
    BOOL,
    DOUBLE,
    FUNCTIONS,
    LONG,
    TESTS,
    Array,
    Several,
    Value,
    join,
    merged,
    number,
    refuse,
    several,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from valve_twin.gateway.fmu.c_kinds import Kind
    from valve_twin.io.errors import FmuError

_ROOMS = (np.zeros, np.empty)
_ARITHMETIC = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*"}
_COMPARISONS = {
    ast.Lt: "<",
    ast.LtE: "<=",
    ast.Gt: ">",
    ast.GtE: ">=",
    ast.Eq: "==",
    ast.NotEq: "!=",
}
_CASTS: dict[type, str] = {int: LONG, float: DOUBLE, bool: BOOL}
_MISSING = object()


class Expressions:
    """What is known inside one function: its variables and the names around it."""

    def __init__(self, plain: Callable[..., object], where: tuple[str, int]) -> None:
        self._where = where
        self._around = dict(plain.__globals__)
        cells = zip(plain.__code__.co_freevars, plain.__closure__ or (), strict=True)
        self._around |= {name: cell.cell_contents for name, cell in cells}
        self.kinds: dict[str, Kind] = {}
        self.alone: ast.Call | None = None
        self._count = 0

    def begin(self) -> None:
        """Start the numbers of `fresh` anew."""
        self._count = 0

    def fresh(self, stem: str) -> str:
        """Return a name that nothing has."""
        self._count += 1
        return f"{stem}{self._count}_"

    def refused(self, node: ast.AST | None, why: str) -> FmuError:
        """Return the error that names the line."""
        return refuse(self._where, node, why)

    def standing_alone(self, node: ast.Call) -> bool:
        """Return whether a call is a statement."""
        return node is self.alone

    def call_compiled(self, node: ast.Call, function: object, values: Sequence[Value]) -> Value:
        """Return the call of another compiled function.

        Parameters
        ----------
        node : ast.Call
            The call, for errors.
        function : compiled function
            What is called.
        values : sequence of Value
            Its arguments in C.
        """
        raise NotImplementedError

    def bind(self, node: ast.AST, name: str, kind: Kind) -> str:
        """Note that a variable takes a value of a kind; return its name in C.

        Parameters
        ----------
        node : ast.AST
            Where, for errors.
        name : str
            The variable.
        kind : Kind
            What it takes.
        """
        old = self.kinds.get(name, kind)
        if isinstance(old, str) and isinstance(kind, str):
            self.kinds[name] = join([old, kind])
        elif isinstance(old, Several) and isinstance(kind, Several) and (m := merged(old, kind)):
            self.kinds[name] = m
        elif old != kind:
            raise self.refused(node, f"{name} is a row here and something else elsewhere")
        else:
            self.kinds[name] = kind
        return f"v_{name}"

    def truth(self, node: ast.expr) -> str:
        """Return a condition."""
        found = self.value(node)
        if not isinstance(found.kind, str):
            raise self.refused(node, "is no number: its truth is not known in C")
        if isinstance(node, (ast.Compare, ast.BoolOp)):
            return found.code[1:-1]  # without its parentheses, of which a compiler would warn
        return found.code if found.kind == BOOL else f"{found.code} != 0"

    def value(self, node: ast.expr) -> Value:  # noqa: PLR0911  one a kind of expression
        """Return an expression."""
        match node:
            case ast.Constant(value=bool() | int() | float() as given):
                return number(given)
            case ast.Name(id=name) if name in self.kinds:
                return Value(f"v_{name}", self.kinds[name])
            case ast.Tuple(elts=parts):
                return several([self.plain(part) for part in parts])
            case ast.Attribute(value=ast.Name(id=name), attr=member) if name in self.kinds:
                kind = self.kinds[name]
                if not isinstance(kind, Several) or member not in kind.names:
                    raise self.refused(node, "is no member of a NamedTuple")
                k = kind.names.index(member)
                return Value(f"v_{name}.f{k}", kind.kinds[k])
            case ast.Name() | ast.Attribute():
                return self._known(node)
            case ast.BinOp():
                return self._binary(node)
            case ast.UnaryOp():
                return self._unary(node)
            case ast.BoolOp(op=op, values=parts):
                return self._both(node, " && " if isinstance(op, ast.And) else " || ", parts)
            case ast.Compare():
                return self._comparison(node)
            case ast.IfExp(test=test, body=body, orelse=orelse):
                one, other = self.plain(body), self.plain(orelse)
                kind = join([str(one.kind), str(other.kind)])
                return Value(f"({self.truth(test)} ? {one.code} : {other.code})", kind)
            case ast.Subscript():
                return self._item(node)
            case ast.Call():
                return self._call(node)
        raise self.refused(node, f"({type(node).__name__}) has no translation into C")

    def plain(self, node: ast.expr) -> Value:
        """Return an expression that is one number."""
        found = self.value(node)
        if not isinstance(found.kind, str):
            raise self.refused(node, "is a row or a tuple where a number belongs")
        return found

    def room(self, node: ast.expr) -> Array | None:
        """Return the row that np.zeros or np.empty makes, None where it is no such call."""
        if not isinstance(node, ast.Call):
            return None
        called = self._found(node.func)
        if not any(called is r for r in _ROOMS):
            return None
        length = self.plain(node.args[0]) if len(node.args) == 1 and not node.keywords else None
        if length is None or not isinstance(length.constant, int) or length.constant < 1:
            raise self.refused(node, "a new row needs one length that is known now, 1 or more")
        return Array(length.constant)

    def _found(self, node: ast.expr) -> object:
        """Return what a name outside the function means, `_MISSING` where it is none."""
        if isinstance(node, ast.Name) and node.id not in self.kinds:
            builtins = {
                f.__name__: f for f in (abs, min, max, len, int, float, bool, range, round)
            }
            return self._around.get(node.id, builtins.get(node.id, _MISSING))
        if isinstance(node, ast.Attribute):
            owner = self._found(node.value)
            if isinstance(owner, (ModuleType, type)):
                return getattr(owner, node.attr, _MISSING)
        return _MISSING

    def _known(self, node: ast.expr) -> Value:
        found = self._found(node)
        if isinstance(found, IntEnum):
            return number(int(found))
        if isinstance(found, (bool, int, float, np.number)):
            return number(found)  # type: ignore[arg-type]
        if found is _MISSING:
            raise self.refused(node, "has no value before it is read, or is not known")
        raise self.refused(node, f"is a {type(found).__name__}: only numbers have a translation")

    def _binary(self, node: ast.BinOp) -> Value:
        a, b = self.plain(node.left), self.plain(node.right)
        kind = join([str(a.kind), str(b.kind), LONG])
        if type(node.op) in _ARITHMETIC:
            folded = self._folded(node.op, a, b)
            sign = _ARITHMETIC[type(node.op)]
            return folded or Value(f"({a.code} {sign} {b.code})", kind)
        if isinstance(node.op, ast.Div):
            return Value(f"((double){a.code} / {b.code})", DOUBLE)
        whole = kind == LONG
        if isinstance(node.op, ast.FloorDiv):
            code = f"vt_div_l({a.code}, {b.code})" if whole else f"vt_div({a.code}, {b.code})"
            return Value(code, kind)
        if isinstance(node.op, ast.Mod):
            return Value(f"vt_mod{'_l' if whole else ''}({a.code}, {b.code})", kind)
        if isinstance(node.op, ast.Pow):
            if whole:
                raise self.refused(node, "a power of whole numbers: write its base as a float")
            if b.kind == DOUBLE:
                return Value(f"pow({a.code}, {b.code})", DOUBLE)
            return Value(f"vt_power({a.code}, {b.code})", DOUBLE)
        raise self.refused(node, f"({type(node.op).__name__}) has no translation into C")

    @staticmethod
    def _folded(op: ast.operator, a: Value, b: Value) -> Value | None:
        """Return sums of whole numbers known now: lengths and indices are made of them."""
        x, y = a.constant, b.constant
        if not isinstance(x, int) or not isinstance(y, int):
            return None
        return number({ast.Add: x + y, ast.Sub: x - y, ast.Mult: x * y}[type(op)])

    def _unary(self, node: ast.UnaryOp) -> Value:
        if isinstance(node.op, ast.Not):
            return Value(f"(!({self.truth(node.operand)}))", BOOL)
        found = self.plain(node.operand)
        if isinstance(node.op, ast.UAdd):
            return found
        if not isinstance(node.op, ast.USub):
            raise self.refused(node, "has no translation into C")
        if found.constant is not None and found.kind != BOOL:
            return number(-found.constant)
        return Value(f"(-{found.code})", join([str(found.kind), LONG]))

    def _both(self, node: ast.expr, sign: str, parts: Sequence[ast.expr]) -> Value:
        values = [self.plain(p) for p in parts]
        if any(v.kind != BOOL for v in values):
            raise self.refused(node, "and, or are for conditions: write a comparison")
        return Value(f"({sign.join(v.code for v in values)})", BOOL)

    def _comparison(self, node: ast.Compare) -> Value:
        values = [self.plain(n) for n in (node.left, *node.comparators)]
        parts = []
        for i, op in enumerate(node.ops):
            if type(op) not in _COMPARISONS:
                raise self.refused(node, f"({type(op).__name__}) has no translation into C")
            parts.append(f"{values[i].code} {_COMPARISONS[type(op)]} {values[i + 1].code}")
        return Value(f"({' && '.join(parts)})", BOOL)

    def _item(self, node: ast.Subscript) -> Value:
        row = self.value(node.value)
        if isinstance(node.slice, ast.Slice):
            return self._part(node, row, node.slice)
        index = self.plain(node.slice)
        if isinstance(row.kind, Several):
            if not isinstance(index.constant, int) or not 0 <= index.constant < len(
                row.kind.kinds
            ):
                raise self.refused(node, "a tuple needs an index that is known now")
            return Value(f"{row.code}.f{index.constant}", row.kind.kinds[index.constant])
        if not isinstance(row.kind, Array):
            raise self.refused(node, "is no row")
        if index.kind != LONG:
            raise self.refused(node, "an index is a whole number")
        if isinstance(index.constant, int):
            k = index.constant
            if not -row.kind.length <= k < row.kind.length:
                raise self.refused(node, f"lies outside its {row.kind.length} numbers")
            return Value(f"{row.code}[{k % row.kind.length}]", DOUBLE)
        return Value(f"{row.code}[vt_at({index.code}, {row.kind.length})]", DOUBLE)

    def _part(self, node: ast.Subscript, row: Value, part: ast.Slice) -> Value:
        if not isinstance(row.kind, Array) or part.step is not None:
            raise self.refused(node, "only rows have parts, without a step")
        ends = []
        for end in (part.lower, part.upper):
            found = None if end is None else self.plain(end).constant
            if end is not None and not isinstance(found, int):
                raise self.refused(node, "the ends of a part must be known now")
            ends.append(found)
        start, stop, _ = slice(*ends).indices(row.kind.length)
        if stop < start:
            raise self.refused(node, "is empty")
        return Value(f"({row.code} + {start})", Array(stop - start))

    def _call(self, node: ast.Call) -> Value:
        if node.keywords:
            raise self.refused(node, "arguments by name have no translation into C")
        found = self._found(node.func)
        if found is len:
            row = self.value(node.args[0])
            if not isinstance(row.kind, Array):
                raise self.refused(node, "is no row")
            return number(row.kind.length)
        if isinstance(found, Dispatcher):
            return self.call_compiled(node, found, [self.value(a) for a in node.args])
        values = [self.plain(a) for a in node.args]
        if isinstance(found, type) and issubclass(found, tuple) and hasattr(found, "_fields"):
            if len(values) != len(found._fields):
                raise self.refused(node, f"needs {len(found._fields)} numbers")
            return several(values, found._fields)
        codes = [v.code for v in values]
        kinds = [str(v.kind) for v in values]
        if (found is min or found is max) and len(values) > 1:
            return self._extreme("min" if found is min else "max", codes, join([*kinds, LONG]))
        if found is abs and len(values) == 1:
            return Value(
                f"fabs({codes[0]})" if kinds[0] == DOUBLE else f"llabs({codes[0]})",
                join([*kinds, LONG]),
            )
        if isinstance(found, type) and found in _CASTS and len(values) == 1:
            kind = _CASTS[found]
            code = f"({codes[0]} != 0)" if found is bool else f"(({kind}){codes[0]})"
            return Value(code, kind)
        name = self._function(found)
        if name in TESTS.values():
            return Value(f"({name}((double){codes[0]}) != 0)", BOOL)
        if not name:
            raise self.refused(node, "calls what is neither compiled nor a function of math")
        kind = LONG if found is math.floor or found is math.ceil else DOUBLE
        code = f"{name}({', '.join(codes)})"
        return Value(f"((long long){code})" if kind == LONG else code, kind)

    @staticmethod
    def _extreme(name: str, codes: Sequence[str], kind: str) -> Value:
        code = codes[0]
        for other in codes[1:]:
            code = f"vt_{name}{'_l' if kind == LONG else ''}({code}, {other})"
        return Value(code, kind)

    @staticmethod
    def _function(found: object) -> str:
        try:
            return TESTS.get(found) or FUNCTIONS.get(found, "")
        except TypeError:  # not hashable
            return ""
