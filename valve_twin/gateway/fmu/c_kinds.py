# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Kinds of values in the C of a law, and the functions that both languages have."""

from __future__ import annotations

import ast
import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from valve_twin.io.errors import FmuError

if TYPE_CHECKING:
    from collections.abc import Sequence

BOOL, LONG, DOUBLE = "int", "long long", "double"
_ORDER = (BOOL, LONG, DOUBLE)
_LETTERS = {BOOL: "b", LONG: "l", DOUBLE: "d"}


@dataclass(frozen=True, slots=True)
class Array:
    """A row of `length` doubles."""

    length: int


@dataclass(frozen=True, slots=True)
class Several:
    """A tuple of numbers, with `names` where it is a NamedTuple: a struct, members f0, f1 ..."""

    kinds: tuple[str, ...]
    names: tuple[str, ...] = ()

    @property
    def struct(self) -> str:
        """Its type in C, which says what its members are."""
        return "vt_t_" + "".join(_LETTERS[kind] for kind in self.kinds)


Kind: TypeAlias = "str | Array | Several"


@dataclass(frozen=True, slots=True)
class Value:
    """An expression in C and its kind.

    `constant` where it is known now, `parts` where it is a tuple made here.
    """

    code: str
    kind: Kind
    constant: int | float | None = None
    parts: tuple[str, ...] = ()


_SAME = (
    ("exp", "expm1", "log", "log1p", "log2", "log10", "sqrt", "hypot", "copysign", "fmod", "fabs"),
    ("sin", "cos", "tan", "sinh", "cosh", "tanh", "asin", "acos", "atan", "atan2"),
    ("floor", "ceil", "pow"),
)
_OTHER = {"arcsin": "asin", "arccos": "acos", "arctan": "atan", "arctan2": "atan2", "power": "pow"}

FUNCTIONS: dict[object, str] = {
    getattr(module, name): c
    for module in (math, np)
    for name, c in {**{n: n for names in _SAME for n in names}, **_OTHER}.items()
    if hasattr(module, name)
}
"""Functions of doubles by what is called in Python."""

TESTS = {
    math.isfinite: "isfinite",
    np.isfinite: "isfinite",
    math.isnan: "isnan",
    np.isnan: "isnan",
}
"""Questions about a double by what is called in Python."""


def refuse(where: tuple[str, int], node: ast.AST | None, why: str) -> FmuError:
    """Return the error that names file and line of what has no translation.

    Parameters
    ----------
    where : tuple of str and int
        File, and the line before its first one.
    node : ast.AST, optional
        What cannot be translated.
    why : str
        The reason.
    """
    line = where[1] + getattr(node, "lineno", 1)
    text = f" `{ast.unparse(node)}`" if isinstance(node, (ast.expr, ast.stmt)) else ""
    short = text if len(text) <= 100 else f"{text[:97]}...`"
    return FmuError(f"{where[0]}:{line}:{short.splitlines()[0] if short else ''} {why}")


def join(kinds: Sequence[str]) -> str:
    """Return the kind that holds values of all these kinds."""
    return max(kinds, key=_ORDER.index)


def merged(one: Several, other: Several) -> Several | None:
    """Return the tuple that holds either; None where there is none."""
    if len(one.kinds) != len(other.kinds):
        return None
    kinds = tuple(join(pair) for pair in zip(one.kinds, other.kinds, strict=True))
    return Several(kinds, one.names or other.names)


def several(parts: Sequence[Value], names: tuple[str, ...] = ()) -> Value:
    """Return a tuple of numbers that is made here."""
    kind = Several(tuple(str(part.kind) for part in parts), names)
    codes = tuple(part.code for part in parts)
    return Value(literal(kind, codes), kind, None, codes)


def literal(kind: Several, parts: Sequence[str]) -> str:
    """Return a tuple in C."""
    return f"({kind.struct}){{{', '.join(parts)}}}"


def structs(text: str) -> str:
    """Return the types of the tuples that occur in some C."""
    kinds = {letter: kind for kind, letter in _LETTERS.items()}
    found = sorted(set(re.findall(r"\bvt_t_([bld]+)\b", text)))
    members = (" ".join(f"{kinds[c]} f{i};" for i, c in enumerate(letters)) for letters in found)
    return "".join(
        f"typedef struct {{ {inside} }} vt_t_{letters};\n"
        for letters, inside in zip(found, members, strict=True)
    )


def number(value: float) -> Value:
    """Return a number known now."""
    if isinstance(value, (bool, np.bool_)):
        return Value(str(int(value)), BOOL, int(value))
    if isinstance(value, (int, np.integer)):
        return Value(f"{int(value)}LL", LONG, int(value))
    plain = float(value)
    if math.isnan(plain):
        return Value("NAN", DOUBLE, plain)
    if math.isinf(plain):
        return Value("INFINITY" if plain > 0.0 else "(-INFINITY)", DOUBLE, plain)
    return Value(f"({plain!r})" if plain < 0.0 else repr(plain), DOUBLE, plain)


HELPERS = """\
static inline double vt_min(double a, double b) { return b < a ? b : a; }
static inline double vt_max(double a, double b) { return b > a ? b : a; }
static inline long long vt_min_l(long long a, long long b) { return b < a ? b : a; }
static inline long long vt_max_l(long long a, long long b) { return b > a ? b : a; }
static inline long long vt_div_l(long long a, long long b)
{
    long long q = b ? a / b : 0;
    return b && a % b != 0 && (a % b < 0) != (b < 0) ? q - 1 : q;
}
static inline long long vt_mod_l(long long a, long long b)
{
    return b ? a - b * vt_div_l(a, b) : 0;
}
static inline double vt_mod(double a, double b)
{
    double r = fmod(a, b);
    if (r == 0.0) return copysign(0.0, b);
    return (r < 0.0) != (b < 0.0) ? r + b : r;
}
static inline double vt_div(double a, double b)
{
    double r = fmod(a, b), q = (a - r) / b;
    if (b == 0.0) return a / b;
    if (r != 0.0 && (r < 0.0) != (b < 0.0)) q -= 1.0;
    if (q == 0.0) return copysign(0.0, a / b);
    return q - floor(q) > 0.5 ? floor(q) + 1.0 : floor(q);
}
static inline long long vt_at(long long i, long long n) { return i < 0 ? i + n : i; }
static inline double vt_power(double a, long long n)
{
    double r = 1.0;
    unsigned long long k = n < 0 ? 0 - (unsigned long long)n : (unsigned long long)n;
    for (; k; k >>= 1, a *= a)
        if (k & 1) r *= a;
    return n < 0 ? 1.0 / r : r;
}
"""
"""What Python does otherwise than C."""
