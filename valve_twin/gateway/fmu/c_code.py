# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""C from the compiled functions of a law: the restricted Python of a step, statement by statement.

Translated are arithmetic, comparisons, conditions, loops over ranges, min, max, the functions of
`math`, rows of doubles with their parts, tuples of numbers, NamedTuples too, and calls of other
compiled functions. Anything else is refused with its file and line, never guessed. A division by
0 gives inf or NaN as C does, where the compiled Python raises.
"""

from __future__ import annotations

import ast
import inspect
import textwrap
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from numba.core.dispatcher import Dispatcher

from valve_twin.gateway.fmu.c_expressions import Expressions
from valve_twin.gateway.fmu.c_kinds import (
    DOUBLE,
    HELPERS,
    LONG,
    Array,
    Several,
    Value,
    join,
    literal,
    merged,
    refuse,
    structs,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from valve_twin.gateway.fmu.c_kinds import Kind


@dataclass(frozen=True, slots=True)
class _Written:
    """A translated function: its name and what it returns, None = nothing."""

    name: str
    returns: Kind | None


@dataclass
class Translation:
    """The functions of one law in C, in the order in which C wants them."""

    _done: dict[tuple[object, tuple[Kind, ...]], _Written | None] = field(default_factory=dict)
    _text: list[str] = field(default_factory=list)
    _names: set[str] = field(default_factory=set)

    def add(self, function: Callable[..., object], kinds: Sequence[Kind]) -> _Written:
        """Translate a compiled function for arguments of these kinds, unless it is done.

        Raises
        ------
        FmuError
            If it does what has no translation; names file and line.
        """
        key = (function, tuple(kinds))
        plain = function.py_func if isinstance(function, Dispatcher) else function
        if key in self._done:
            known = self._done[key]
            if known is None:
                raise refuse(_place(plain), None, f"{plain.__name__} calls itself: not translated")
            return known
        self._done[key] = None
        name = self._new_name(plain.__name__)
        body = _Function(self, plain, name, kinds)
        self._text.append(body.translate())
        self._done[key] = found = _Written(name, body.returns)
        return found

    def text(self) -> str:
        """Return the C: helpers, then the functions."""
        heads = "#include <math.h>\n#include <stdlib.h>\n#include <string.h>\n"
        made = "\n".join(self._text)
        return "\n".join([heads, HELPERS, structs(made) + made])

    def _new_name(self, base: str) -> str:
        stem = f"law_{base.strip('_')}"
        name, k = stem, 2
        while name in self._names:
            name, k = f"{stem}_{k}", k + 1
        self._names.add(name)
        return name


def _place(plain: Callable[..., object]) -> tuple[str, int]:
    code = plain.__code__
    return Path(code.co_filename).name, code.co_firstlineno - 1


def _tree(plain: Callable[..., object]) -> ast.FunctionDef:
    try:
        source = textwrap.dedent(inspect.getsource(plain))
    except (OSError, TypeError) as err:
        raise refuse(_place(plain), None, f"{plain.__name__} has no source text: {err}") from err
    (tree,) = ast.parse(source).body
    if not isinstance(tree, ast.FunctionDef):
        raise refuse(_place(plain), tree, "is no function of statements")
    return tree


class _Function(Expressions):
    """One function on its way to C."""

    def __init__(
        self,
        whole: Translation,
        plain: Callable[..., object],
        name: str,
        kinds: Sequence[Kind],
    ) -> None:
        super().__init__(plain, _place(plain))
        self._whole, self._tree, self._name = whole, _tree(plain), name
        given = self._tree.args
        self._arguments = [a.arg for a in given.args]
        if given.vararg or given.kwarg or given.kwonlyargs or len(self._arguments) != len(kinds):
            raise self.refused(None, f"{plain.__name__} takes other arguments than {len(kinds)}")
        self.kinds = dict(zip(self._arguments, kinds, strict=True))
        self._given = dict(self.kinds)
        self.returns: Kind | None = None
        self._rooms: list[str] = []
        self._loops = 0
        self._made_again: ast.stmt | None = None
        self._renamed = False

    def translate(self) -> str:
        """Return the C; the kinds of the variables are found by going over it until they stay."""
        before: object = None
        lines: list[str] = []
        while before != (self.kinds, self.returns):
            before = (dict(self.kinds), self.returns)
            self.begin()
            self._rooms, self._made_again, self._renamed = [], None, False
            lines = self._block(self._tree.body)
        if self._made_again is not None and self._renamed:
            why = "makes a row anew in a loop that keeps rows by another name"
            raise self.refused(self._made_again, why)
        kind = "void"
        if isinstance(self.returns, Several):
            kind = self.returns.struct
        elif isinstance(self.returns, str):
            kind = self.returns
        head = ", ".join(_declared(self._given[a], a) for a in self._arguments) or "void"
        own = [_declared(k, n) for n, k in self.kinds.items() if n not in self._given]
        own = [f"{d} = {_zero(d)};" for d in own]
        inside = "\n".join(f"    {line}" for line in (*own, *self._rooms, *lines))
        return f"static {kind} {self._name}({head})\n{{\n{inside}\n}}\n"

    def call_compiled(self, node: ast.Call, function: object, values: Sequence[Value]) -> Value:
        """Return the call of another compiled function."""
        written = self._whole.add(function, [v.kind for v in values])  # type: ignore[arg-type]
        code = f"{written.name}({', '.join(v.code for v in values)})"
        kind = written.returns
        if kind is None:
            if not self.standing_alone(node):
                raise self.refused(node, "returns nothing")
            return Value(code, LONG)
        return Value(code, kind)

    def _block(self, body: Iterable[ast.stmt]) -> list[str]:
        return [line for statement in body for line in self._statement(statement)]

    def _indented(self, body: Iterable[ast.stmt]) -> list[str]:
        return [f"    {line}" for line in self._block(body)]

    def _repeated(self, body: Iterable[ast.stmt]) -> list[str]:
        self._loops += 1
        lines = self._indented(body)
        self._loops -= 1
        return lines

    def _statement(self, s: ast.stmt) -> list[str]:  # noqa: PLR0911  one a kind of statement
        match s:
            case ast.Expr(value=ast.Constant()) | ast.Pass() | ast.Delete():
                return []
            case ast.Expr(value=ast.Call() as call):
                self.alone = call
                return [f"{self.value(call).code};"]
            case ast.Assign(targets=targets, value=value):
                return self._assign(s, targets, value)
            case ast.AnnAssign(target=target, value=value) if value is not None:
                return self._assign(s, [target], value)
            case ast.AugAssign(target=target, op=op, value=value):
                whole = ast.copy_location(ast.BinOp(_read(target), op, value), s)
                return self._assign(s, [target], whole)
            case ast.If(test=test, body=body, orelse=orelse):
                lines = [f"if ({self.truth(test)}) {{", *self._indented(body), "}"]
                if orelse:
                    lines[-1:] = ["} else {", *self._indented(orelse), "}"]
                return lines
            case ast.While(test=test, body=body, orelse=[]):
                return [f"while ({self.truth(test)}) {{", *self._repeated(body), "}"]
            case ast.For(target=ast.Name() as target, iter=ast.Call() as over, orelse=[]):
                return self._loop(s, target, over)
            case ast.Break():
                return ["break;"]
            case ast.Continue():
                return ["continue;"]
            case ast.Return():
                return self._return(s)
        raise self.refused(s, f"({type(s).__name__}) has no translation into C")

    def _loop(self, s: ast.For, target: ast.Name, over: ast.Call) -> list[str]:
        if not isinstance(over.func, ast.Name) or over.func.id != "range" or over.keywords:
            raise self.refused(over, "loops are over range(...) only")
        given = [self.value(a) for a in over.args]
        if any(v.kind != LONG for v in given) or not 1 <= len(given) <= 3:
            raise self.refused(over, "a range needs whole numbers")
        first = Value("0LL", LONG) if len(given) == 1 else given[0]
        last = given[0] if len(given) == 1 else given[1]
        step = given[2].constant if len(given) == 3 else 1
        if not isinstance(step, int) or step == 0:
            raise self.refused(over, "the step of a range must be a number known now, not 0")
        k, sign = self.fresh("k"), "<" if step > 0 else ">"
        name = self.bind(s, target.id, LONG)
        begin = f"long long {k} = {first.code}, {k}e = {last.code}"
        head = f"for ({begin}; {k} {sign} {k}e; {k} += {step})"
        return [f"{head} {{", f"    {name} = {k};", *self._repeated(s.body), "}"]

    def _assign(self, s: ast.stmt, targets: list[ast.expr], value: ast.expr) -> list[str]:
        if len(targets) == 1 and isinstance(targets[0], (ast.Tuple, ast.List)):
            return self._unpack(s, targets[0].elts, value)
        made = self.room(value)
        if made is not None:
            (target,) = targets
            if not isinstance(target, ast.Name):
                raise self.refused(s, "a new row needs a name")
            name = self.bind(s, target.id, made)
            room = self.fresh("room")
            self._rooms.append(f"double {room}[{made.length}];")
            if self._loops:
                self._made_again = s
            return [f"memset({room}, 0, sizeof {room});", f"{name} = {room};"]
        found = self.value(value)
        if len(targets) > 1:
            if not isinstance(found.kind, str):
                raise self.refused(s, "several names for one row or tuple")
            t = self.fresh("t")
            found, lines = Value(t, found.kind), [f"{found.kind} {t} = {found.code};"]
        else:
            lines = []
        for target in targets:
            lines += self._put(s, target, found)
        return lines

    def _unpack(self, s: ast.stmt, targets: list[ast.expr], value: ast.expr) -> list[str]:
        if isinstance(value, (ast.Tuple, ast.List)):
            values = [self.value(v) for v in value.elts]
            lines = []
            for i, v in enumerate(values):
                t = self.fresh("t")
                lines.append(f"{_type(v.kind)}{t} = {v.code};")
                values[i] = Value(t, v.kind)
        else:
            whole = self.value(value)
            if not isinstance(whole.kind, Several):
                raise self.refused(s, "is no tuple of known length")
            t = self.fresh("t")
            lines = [f"{whole.kind.struct} {t} = {whole.code};"]
            values = [Value(f"{t}.f{i}", k) for i, k in enumerate(whole.kind.kinds)]
        if len(values) != len(targets):
            raise self.refused(s, f"{len(values)} values for {len(targets)} names")
        for target, found in zip(targets, values, strict=True):
            lines += self._put(s, target, found)
        return lines

    def _put(self, s: ast.stmt, target: ast.expr, found: Value) -> list[str]:
        if isinstance(target, ast.Name):
            if isinstance(found.kind, Array):
                self._renamed |= self._loops > 0
            name = self.bind(s, target.id, found.kind)
            return [f"{name} = {self._fitted(s, found, self.kinds[target.id])};"]
        if not isinstance(target, ast.Subscript):
            raise self.refused(s, "cannot be assigned in C")
        to = self.value(target)
        if isinstance(found.kind, Several):
            raise self.refused(s, "puts a tuple where a number belongs")
        if not isinstance(to.kind, Array):
            if not isinstance(found.kind, str):
                raise self.refused(s, "puts a row where a number belongs")
            return [f"{to.code} = {found.code};"]
        if isinstance(found.kind, Array):
            if found.kind.length != to.kind.length:
                raise self.refused(s, f"puts {found.kind.length} numbers in {to.kind.length}")
            size = f"{to.kind.length} * sizeof(double)"
            return [f"memmove({to.code}, {found.code}, {size});"]  # the parts may overlap
        k, t = self.fresh("k"), self.fresh("t")  # the number may be made of the part's own
        return [
            f"double {t} = {found.code};",
            f"for (long long {k} = 0; {k} < {to.kind.length}; {k}++) ({to.code})[{k}] = {t};",
        ]

    def _fitted(self, s: ast.stmt, found: Value, kind: Kind) -> str:
        """Return a value as what is kept in its place: of a tuple made here, its parts."""
        if not isinstance(kind, Several) or not isinstance(found.kind, Several):
            return found.code
        if found.kind.struct != kind.struct and not found.parts:
            raise self.refused(s, "is a tuple of other kinds of numbers than elsewhere")
        return literal(kind, found.parts) if found.parts else found.code

    def _return(self, s: ast.Return) -> list[str]:
        if s.value is None:
            return ["return;"]
        found = self.value(s.value)
        if isinstance(found.kind, Several):
            old = found.kind if self.returns is None else self.returns
            kind = merged(old, found.kind) if isinstance(old, Several) else None
            if kind is None:
                raise self.refused(s, "returns another number of values than elsewhere")
            self.returns = kind
            return [f"return {self._fitted(s, found, kind)};"]
        if not isinstance(found.kind, str) or isinstance(self.returns, Several):
            raise self.refused(s, "returns a row, or a tuple here and a number there")
        before = self.returns if isinstance(self.returns, str) else found.kind
        self.returns = join([found.kind, before])
        return [f"return {found.code};"]


def _type(kind: Kind) -> str:
    if isinstance(kind, Array):
        return "double *"
    return f"{kind.struct if isinstance(kind, Several) else kind} "


def _read(target: ast.expr) -> ast.expr:
    copy = ast.parse(ast.unparse(target), mode="eval").body
    return ast.copy_location(copy, target)


def _declared(kind: Kind, name: str) -> str:
    return f"{_type(kind)}v_{name}"


def _zero(declared: str) -> str:
    if declared.startswith("vt_t_"):
        return "{0}"
    return "0.0" if declared.startswith(f"{DOUBLE} v_") else "0"
