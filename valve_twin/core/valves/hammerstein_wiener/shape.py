# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Which blocks a Hammerstein-Wiener model has, and the numbers that a search moves.

The linear block is moved by its reflection coefficients, each between -1 and 1: all poles are
inside the unit circle whatever the search does. Its gain is 1; that of the valve is in the curve.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

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

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

INPUT_KNOTS, OUTPUT_KNOTS = 7, 6
"""Knots of a curve that is not straight."""

_STEADY = 0.99999  # greatest reflection coefficient [1]
_SHARE = 5.0  # greatest share of one command in the linear block's input [1]
_SLOWEST = 1e-4  # lowest rate a sample [1]
_STEEP = 3.0  # greatest logarithm of a step of the rising curve over the first


@dataclass(frozen=True, slots=True)
class Shape:
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


@dataclass(frozen=True, slots=True)
class Ranges:
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
    c = np.zeros(SIZE)
    c[LAG] = shape.lag
    reflections, shares, rates, levels, steps = shape.parts
    feedback = feedback_of(z[reflections])
    c[A : A + shape.order] = feedback
    c[B] = 1.0
    if shape.order:
        gain = 1.0 + float(feedback.sum())
        c[B : B + shape.order] = gain * np.append(1.0 - z[shares].sum(), z[shares])
    if shape.rates:
        c[[RISE, FALL]] = z[rates][:2]
        c[[RISE_LIMIT, FALL_LIMIT]] = z[rates][2:] * ranges.span
    low = ranges.output[0]
    c[INPUT : INPUT + 3] = shape.knots, *ranges.command
    c[INPUT + 3 : INPUT + 3 + shape.knots] = low + ranges.span * z[levels]
    if shape.bent:
        rise = np.exp(np.append(0.0, z[steps]))
        rising = low + ranges.span * np.append(0.0, np.cumsum(rise) / rise.sum())
        c[OUTPUT : OUTPUT + 3] = OUTPUT_KNOTS, *ranges.output
        c[OUTPUT + 3 : OUTPUT + 3 + OUTPUT_KNOTS] = rising
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


def feedback_of(reflections: FloatArray) -> FloatArray:
    """Return the a (P,) of 1 + a1 q^-1 + .. by Levinson's recursion.

    Parameters
    ----------
    reflections : (P,) array
        Reflection coefficients [1].
    """
    a = np.empty(0)
    for k in reflections:
        a = np.append(a + k * a[::-1], k)
    return a


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
