# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Which blocks a Hammerstein-Wiener model has, and the numbers that a search moves.

The linear block is moved by its reflection coefficients, each between -1 and 1: all poles are
inside the unit circle whatever the search does. Its gain is 1; that of the valve is in the curve.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from valve_twin.core.valves.hammerstein_wiener.kernels import (
    FALL,
    FALL_LIMIT,
    INPUT,
    LAG,
    OUTPUT,
    RISE,
    RISE_LIMIT,
    SIZE,
    A,
    B,
    curve,
)
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

INPUT_KNOTS, OUTPUT_KNOTS = 7, 6
"""Knots of a curve that is not straight."""

_STEADY = 0.99999  # greatest reflection coefficient [1]
_SHARE = 5.0  # greatest share of one command in the linear block's input [1]
_SLOWEST = 1e-4  # lowest rate a sample [1]
_STEEP = 3.0  # greatest logarithm of a step of the rising curve over the first


class Shape(NamedTuple):
    """Which blocks there are.

    Attributes
    ----------
    lag : int
        Command to output [samples].
    order : int
        Of the linear block, 0 = none.
    rates : bool
        Whether each direction has its rate and its limit.
    curved : bool
        Whether the curve of the command has more than two knots.
    bent : bool
        Whether the output has a curve.
    """

    lag: int
    order: int
    rates: bool = False
    curved: bool = False
    bent: bool = False

    @property
    def knots(self) -> int:
        """Knots of the command's curve."""
        return INPUT_KNOTS if self.curved else 2

    @property
    def parts(self) -> tuple[slice, slice, slice, slice, slice]:
        """Where in z reflections, shares, rates, levels and steps of the output stand."""
        found, at = [], 0
        sizes = (self.order, max(self.order - 1, 0), 4 * self.rates, self.knots)
        for size in (*sizes, (OUTPUT_KNOTS - 2) * self.bent):
            found.append(slice(at, at + size))
            at += size
        return found[0], found[1], found[2], found[3], found[4]

    @property
    def size(self) -> int:
        """Numbers in z."""
        return int(self.parts[-1].stop)

    def __str__(self) -> str:
        """Return what it is, in words."""
        extra = (("rates", self.rates), ("input curve", self.curved), ("output curve", self.bent))
        words = [f"order {self.order}", f"lag {self.lag}", *(w for w, there in extra if there)]
        return ", ".join(words)


class Ranges(NamedTuple):
    """What command and output range over: lowest and highest of each [their units]."""

    command: tuple[float, float]
    output: tuple[float, float]

    @property
    def span(self) -> float:
        """Of the output."""
        return self.output[1] - self.output[0]


def bounds_of(shape: Shape) -> tuple[FloatArray, FloatArray]:
    """Return the (P,) lower and upper bounds of z.

    Parameters
    ----------
    shape : Shape
        Blocks.
    """
    lower, upper = np.full(shape.size, -20.0), np.full(shape.size, 20.0)
    reflections, shares, rates, _, steps = shape.parts
    lower[reflections], upper[reflections] = -_STEADY, _STEADY
    lower[shares], upper[shares] = -_SHARE, _SHARE
    if shape.rates:
        lower[rates] = [_SLOWEST, _SLOWEST, _SLOWEST, _SLOWEST]
        upper[rates] = [1.0, 1.0, 2.0, 2.0]
    lower[steps], upper[steps] = -_STEEP, _STEEP
    return lower, upper


def start_of(shape: Shape, gain: float, level: float, ranges: Ranges) -> FloatArray:
    """Return a z (P,) without dynamics whose static curve is a line.

    Parameters
    ----------
    shape : Shape
        Blocks.
    gain, level : float
        The line [output/command], [output].
    ranges : Ranges
        Of the record.
    """
    z = np.zeros(shape.size)
    _, _, rates, levels, _ = shape.parts
    if shape.rates:
        z[rates] = [0.9, 0.9, 1.0, 1.0]
    at = np.linspace(*ranges.command, shape.knots)
    z[levels] = (gain * at + level - ranges.output[0]) / ranges.span
    return z


@njit(cache=True)
def feedback_of(reflections: FloatArray) -> FloatArray:
    """Return the a (P,) of 1 + a1 q^-1 + .. by Levinson's recursion.

    Parameters
    ----------
    reflections : (P,) array
        Reflection coefficients [1].
    """
    a = reflections.copy()
    for n in range(1, len(a)):
        a[:n] += a[n] * a[:n][::-1].copy()
    return a


@njit(cache=True)
def coefficients_of(z: FloatArray, shape: Shape, ranges: Ranges) -> FloatArray:
    """Return the (SIZE,) coefficients of the kernels.

    Parameters
    ----------
    z : (P,) array
        What the search moves: reflections, shares, rates, levels over the output's range,
        steps [1].
    shape : Shape
        Blocks.
    ranges : Ranges
        Of the record.
    """
    c, order = np.zeros(SIZE), shape.order
    low, span = ranges.output[0], ranges.output[1] - ranges.output[0]
    c[LAG] = shape.lag
    c[B] = 1.0
    at = order + max(order - 1, 0)  # z is laid out as `Shape.parts` says
    if order:
        c[A : A + order] = feedback_of(z[:order])
        gain = 1.0 + c[A : A + order].sum()
        c[B] = gain * (1.0 - z[order:at].sum())
        c[B + 1 : B + order] = gain * z[order:at]
    if shape.rates:
        c[RISE], c[FALL] = z[at], z[at + 1]
        c[RISE_LIMIT], c[FALL_LIMIT] = z[at + 2] * span, z[at + 3] * span
        at += 4
    knots = INPUT_KNOTS if shape.curved else 2
    c[INPUT], c[INPUT + 1], c[INPUT + 2] = knots, ranges.command[0], ranges.command[1]
    c[INPUT + 3 : INPUT + 3 + knots] = low + span * z[at : at + knots]
    if shape.bent:
        rise = np.ones(OUTPUT_KNOTS - 1)
        rise[1:] = np.exp(z[at + knots : at + knots + OUTPUT_KNOTS - 2])
        c[OUTPUT], c[OUTPUT + 1], c[OUTPUT + 2] = OUTPUT_KNOTS, low, ranges.output[1]
        c[OUTPUT + 3] = low
        c[OUTPUT + 4 : OUTPUT + 3 + OUTPUT_KNOTS] = low + span * (np.cumsum(rise) / rise.sum())
    return c


def numbers_of(c: FloatArray, shape: Shape, ranges: Ranges) -> FloatArray:
    """Return the z (P,) of coefficients (SIZE,), inside its bounds: where a search goes on.

    Curves are read anew at the knots of `ranges`.

    Parameters
    ----------
    c : (SIZE,) array
        Coefficients [units of the signals].
    shape : Shape
        Blocks.
    ranges : Ranges
        Of the record.
    """
    z = start_of(shape, 0.0, 0.0, ranges)
    reflections, shares, rates, levels, steps = shape.parts
    feedback = c[A : A + shape.order]
    if shape.order:
        z[reflections] = reflections_of(feedback)
        z[shares] = c[B + 1 : B + shape.order] / (1.0 + float(feedback.sum()))
    if shape.rates and c[RISE] > 0.0:
        z[rates] = [c[RISE], c[FALL], c[RISE_LIMIT] / ranges.span, c[FALL_LIMIT] / ranges.span]
    at = np.linspace(*ranges.command, shape.knots)
    settled = np.array([curve(float(u), c[INPUT:OUTPUT]) for u in at])
    z[levels] = (settled - ranges.output[0]) / ranges.span
    if shape.bent and c[OUTPUT] > 0.0:
        at = np.linspace(*ranges.output, OUTPUT_KNOTS)
        rise = np.diff([curve(float(x), c[OUTPUT:SIZE]) for x in at])
        z[steps] = np.log(np.maximum(rise[1:], 1e-9) / max(rise[0], 1e-9))
    lower, upper = bounds_of(shape)
    inside: FloatArray = np.clip(z, lower, upper)
    return inside


def reflections_of(feedback: FloatArray) -> FloatArray:
    """Return the reflection coefficients (P,) of a stable linear block.

    Parameters
    ----------
    feedback : (P,) array
        Its a [1].
    """
    a, found = np.asarray(feedback, dtype=np.float64), []
    while len(a):
        k = min(max(float(a[-1]), -_STEADY), _STEADY)
        found.append(k)
        a = (a[:-1] - k * a[:-1][::-1]) / (1.0 - k * k)
    return np.array(found[::-1])
