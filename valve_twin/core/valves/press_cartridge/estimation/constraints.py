# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Linear inequalities over named parameters: those of physics, and those a user writes."""

from __future__ import annotations

import ast
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.quantity import suggest

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.types import FloatArray

THETA = tuple(f"theta_{k}" for k in range(1, 9))
"""Names of the eight parameters of paper 002, eq. (18)."""


@dataclass(frozen=True, slots=True)
class Inequalities:
    """The set matrix @ parameters <= bound.

    Attributes
    ----------
    names : tuple of str
        The K parameters, in column order.
    matrix : (M, K) array
        Coefficients.
    bound : (M,) array
        Right-hand sides.
    labels : tuple of str
        The M inequalities in words, for reasons and errors.
    """

    names: tuple[str, ...]
    matrix: FloatArray
    bound: FloatArray
    labels: tuple[str, ...]

    def __add__(self, other: Inequalities) -> Inequalities:
        """Return both sets together (same parameters)."""
        return Inequalities(
            self.names,
            np.vstack([self.matrix, other.matrix]),
            np.concatenate([self.bound, other.bound]),
            self.labels + other.labels,
        )

    def part(self, columns: Sequence[int]) -> Inequalities:
        """Return the same set with the others at zero, without what then always holds."""
        matrix = self.matrix[:, list(columns)]
        kept = ((matrix != 0.0).any(axis=1) | (self.bound < 0.0)).tolist()
        keep = [i for i, keeps in enumerate(kept) if keeps]
        return Inequalities(
            tuple(self.names[k] for k in columns),
            np.array(matrix[keep], order="C"),
            self.bound[keep],
            tuple(self.labels[i] for i in keep),
        )


def no_inequalities(names: tuple[str, ...] = THETA) -> Inequalities:
    """Return the empty set of inequalities over some parameters."""
    return Inequalities(names, np.zeros((0, len(names))), np.zeros(0), ())


@lru_cache(maxsize=32)
def physical_inequalities(
    *, v_in_max: float = 1.0, v_out_max: float = 1.0, extended: bool = True
) -> Inequalities:
    """Return what the valve's physics says about theta_1 ... theta_8.

    Parameters
    ----------
    v_in_max, v_out_max : float
        Greatest commands [1].
    extended : bool
        With the four inequalities that the paper lacks (equations.md 2.2(7)): pole in [0, 1] at
        every command, inflow and outflow monotone in the command; without them exactly paper 002,
        eq. (22)-(23).
    """
    texts = [
        "theta_1 <= 0",
        "theta_1 >= -1",
        "theta_2 >= 0",
        "theta_3 <= 0",
        "theta_4 <= 0",
        "theta_5 >= 0",
        "theta_7 >= 0",
        "theta_8 >= 0",
    ]
    if extended:
        texts += [
            f"theta_1 + {float(v_in_max)!r} * theta_7 <= 0",
            f"theta_1 + {float(v_out_max)!r} * theta_8 <= 0",
            f"theta_3 + {2.0 * v_out_max!r} * theta_5 <= 0",
            f"theta_2 + {2.0 * v_in_max!r} * theta_4 >= 0",
        ]
    return parse_inequalities(texts)


def parse_inequalities(texts: Sequence[str], names: tuple[str, ...] = THETA) -> Inequalities:
    """Read linear inequalities such as "theta_2 + 0.3*theta_3 <= 0".

    Numbers, the names, + - * / and parentheses; <=, >= or ==; chains such as "0 <= theta_2 <= 1".
    Nothing is evaluated but the arithmetic of numbers.

    Parameters
    ----------
    texts : sequence of str
        One inequality, or chain, each.
    names : tuple of str
        The parameters that may appear.

    Raises
    ------
    ValueError
        The text is not a linear inequality over the names; one line that quotes it and says what
        to do.
    """
    rows: list[FloatArray] = []
    labels: list[str] = []
    for text in texts:
        for row in _parse(str(text), names):
            rows.append(row)
            labels.append(" ".join(str(text).split()))
    table = np.array(rows).reshape(-1, len(names) + 1)
    matrix, bound = table[:, :-1].copy(), 0.0 - table[:, -1]
    matrix.flags.writeable = bound.flags.writeable = False
    return Inequalities(names, matrix, bound, tuple(labels))


def _parse(text: str, names: tuple[str, ...]) -> list[FloatArray]:
    """Rows (K + 1,) of coefficients and constant with row . (parameters, 1) <= 0."""
    try:
        tree = ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError) as err:
        raise _error(text, "it cannot be read") from err
    if not isinstance(tree, ast.Compare):
        raise _error(text, "it has no <=, >= or ==")
    sides = [_linear(side, text, names) for side in (tree.left, *tree.comparators)]
    rows: list[FloatArray] = []
    for operator, left, right in zip(tree.ops, sides, sides[1:], strict=False):
        difference = left - right
        if not difference[:-1].any():
            raise _error(text, "it constrains no parameter")
        if not isinstance(operator, (ast.LtE, ast.GtE, ast.Eq)):
            raise _error(text, "only <=, >= and == are understood")
        if isinstance(operator, (ast.LtE, ast.Eq)):
            rows.append(difference)
        if isinstance(operator, (ast.GtE, ast.Eq)):
            rows.append(-difference)
    return rows


def _linear(node: ast.expr, text: str, names: tuple[str, ...]) -> FloatArray:
    """Coefficients and constant (K + 1,) of a linear expression."""
    value = np.zeros(len(names) + 1)
    if isinstance(node, ast.Constant):
        if isinstance(node.value, bool) or not isinstance(node.value, (int, float)):
            raise _error(text, f"{node.value!r} is not a number")
        value[-1] = float(node.value)
    elif isinstance(node, ast.Name):
        if node.id not in names:
            raise _error(text, f"{node.id} is no parameter; {suggest(node.id, names)}")
        value[names.index(node.id)] = 1.0
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.UAdd, ast.USub)):
        inner = _linear(node.operand, text, names)
        value = -inner if isinstance(node.op, ast.USub) else inner
    elif isinstance(node, ast.BinOp):
        value = _combine(node, text, names)
    else:
        raise _error(text, "only numbers, parameters and + - * / are understood")
    if not np.isfinite(value).all():
        raise _error(text, "a number is not finite")
    return value


def _combine(node: ast.BinOp, text: str, names: tuple[str, ...]) -> FloatArray:
    """Sum, difference, product with or quotient by a number."""
    left, right = _linear(node.left, text, names), _linear(node.right, text, names)
    if isinstance(node.op, ast.Add):
        return left + right
    if isinstance(node.op, ast.Sub):
        return left - right
    if isinstance(node.op, ast.Mult):
        if left[:-1].any() and right[:-1].any():
            raise _error(text, "a product of parameters is not linear")
        factor, other = (right[-1], left) if left[:-1].any() else (left[-1], right)
        return other * float(factor)
    if isinstance(node.op, ast.Div):
        if right[:-1].any() or right[-1] == 0.0:
            raise _error(text, "a quotient needs a number other than 0 below")
        return left / float(right[-1])
    raise _error(text, "only + - * / are understood")


def _error(text: str, what: str) -> ValueError:
    """One line with the text, the fault and an example."""
    remedy = 'write a linear inequality such as "theta_2 + 0.3*theta_3 <= 0"'
    return ValueError(f'constraint "{text}": {what}; {remedy}')
