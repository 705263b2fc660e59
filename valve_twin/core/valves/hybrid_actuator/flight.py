# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Strokes of a cycle, and the fit of spring, damping and magnet to the flights between the seats.

Between the seats the armature obeys m dv/dt = F(i, x) - c v - k x with measured currents. All
flights of a cycle are fitted together by output error: k, c and the magnet's force are shared,
position and speed at the start of each flight are its own. Bounces are left out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.solvers.least_squares import column_condition
from valve_twin.core.valves.hybrid_actuator.plant_kernel import Armature, net_force, rubbing
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from scipy.optimize import OptimizeResult

    from valve_twin.core.types import BoolArray, FloatArray
    from valve_twin.core.valves.hybrid_actuator.magnetics import Magnetics

SEAT_BAND = 0.01
"""Distance to a seat that counts as seated [1]: well above noise, well below a stroke, assumed."""

SHARED = ("spring_rate", "damping", "magnet_force")

_LONGEST_S = 0.03  # longest part of a flight that is fitted, for one that does not land [s]
_FEWEST = 12  # fewest samples of a flight, assumed
_MOST_STROKES = 6  # fitted of a cycle, which has two: noise may look like many
_COULOMB_START = 1.0  # where the search of Coulomb friction starts, above the option [N]
_SUBSTEPS = 2
_SOFT_STEP = 0.25 * SEAT_BAND  # a sample: slower near the seat is a soft landing [1], assumed
_TOUCH = 0.002  # nearer to where it comes to rest it may touch [1], above the noise, assumed
_REST_AFTER, _REST_SAMPLES = 40, 40  # samples: where a soft landing has come to rest, assumed
_STEPS_TO_SEAT = 20  # how far the fitted flight is followed to its seat, in half samples


@dataclass(frozen=True, slots=True)
class Stroke:
    """One flight of the armature.

    Attributes
    ----------
    opening : bool
        Whether it left the closed seat.
    first, end : int
        Samples between the seats: first <= n < end.
    landed : bool
        Whether it reached the other seat.
    fitted : int
        Samples that are fitted: first <= n < fitted; beyond `end` only where it lands softly.
    """

    opening: bool
    first: int
    end: int
    landed: bool
    fitted: int


def find_strokes(position: FloatArray, known: BoolArray, period_s: float) -> list[Stroke]:
    """Return the flights that leave one seat and pass the middle.

    Parameters
    ----------
    position : (N,) array
        Measured position, 0 closed, 1 open [1].
    known : (N,) bool array
        Samples that can be used.
    period_s : float
        Sampling time [s].
    """
    index = np.flatnonzero(known)
    p = position[index]
    seat = np.where(p < SEAT_BAND, -1, np.where(p > 1.0 - SEAT_BAND, 1, 0))
    between = np.concatenate(([False], seat == 0, [False]))
    starts = np.flatnonzero(between[1:] & ~between[:-1])
    ends = np.flatnonzero(~between[1:] & between[:-1])
    found = []
    for start, end in zip(starts, ends, strict=True):
        if start == 0:
            continue  # the flight began before the cycle
        side = int(seat[start - 1])
        if (side * (p[start:end] - 0.5)).min() >= 0.0:
            continue  # a bounce
        landed = bool(end < len(p) and seat[end] == -side)
        last = min(int(index[end - 1]) + 1, int(index[start]) + round(_LONGEST_S / period_s))
        fitted = last
        if landed and last == int(index[end - 1]) + 1:
            fitted = last + _soft_samples(position, known, last)
        found.append(Stroke(side < 0, int(index[start]), last, landed, fitted))
    return found


def _soft_samples(position: FloatArray, known: BoolArray, end: int) -> int:
    """Return how many samples a soft landing still flies inside the band of its seat."""
    rest = slice(end + _REST_AFTER, end + _REST_AFTER + _REST_SAMPLES)
    way, calm = position[end - 1 : rest.start], position[rest]
    sure = known[end - 1 : rest.start].all() and known[rest].all()
    if not sure or len(calm) < _REST_SAMPLES or abs(way[1] - way[0]) > _SOFT_STEP:
        return 0
    touches = np.flatnonzero(np.abs(way[1:] - np.median(calm)) < _TOUCH)
    return int(touches[0]) if len(touches) else 0


@njit(cache=True)
def fly(
    a: Armature,
    solenoid: Magnetics,
    start: tuple[float, float],
    opener: FloatArray,
    closer: FloatArray,
    period: float,
    out: FloatArray,
) -> None:
    """Follow a flight through N samples with given currents; there are no stops.

    Parameters
    ----------
    a, solenoid : Armature, Magnetics
        Numbers of the moving parts and of either solenoid.
    start : tuple of float
        Position [m] and speed [m/s] at the first sample.
    opener, closer : (N,) arrays
        Currents at the samples, straight lines between [A].
    period : float
        Sampling time [s].
    out : (N, 2) array
        Overwritten with position [m] and speed [m/s].
    """
    x, v = start
    h = period / _SUBSTEPS
    out[0, 0], out[0, 1] = x, v
    for n in range(1, len(opener)):
        for k in range(_SUBSTEPS):
            s = k / _SUBSTEPS
            x, v = advance(
                a,
                solenoid,
                x,
                v,
                opener[n - 1] + s * (opener[n] - opener[n - 1]),
                opener[n - 1] + (s + 1.0 / _SUBSTEPS) * (opener[n] - opener[n - 1]),
                closer[n - 1] + s * (closer[n] - closer[n - 1]),
                closer[n - 1] + (s + 1.0 / _SUBSTEPS) * (closer[n] - closer[n - 1]),
                h,
            )
        out[n, 0], out[n, 1] = x, v


@njit(cache=True)
def advance(
    a: Armature,
    solenoid: Magnetics,
    x: float,
    v: float,
    opener_from: float,
    opener_to: float,
    closer_from: float,
    closer_to: float,
    h: float,
) -> tuple[float, float]:
    """Return position [m] and speed [m/s] after `h` seconds of Runge-Kutta of order 4.

    Parameters
    ----------
    a, solenoid : Armature, Magnetics
        Numbers of the moving parts and of either solenoid.
    x, v : float
        Position [m] and speed [m/s] at the beginning.
    opener_from, opener_to, closer_from, closer_to : float
        Currents at beginning and end, straight lines between [A].
    h : float
        Step [s].
    """
    o, c = 0.5 * (opener_from + opener_to), 0.5 * (closer_from + closer_to)
    a1 = _acceleration(a, solenoid, x, v, opener_from, closer_from)
    x2, v2 = x + 0.5 * h * v, v + 0.5 * h * a1
    a2 = _acceleration(a, solenoid, x2, v2, o, c)
    x3, v3 = x + 0.5 * h * v2, v + 0.5 * h * a2
    a3 = _acceleration(a, solenoid, x3, v3, o, c)
    x4, v4 = x + h * v3, v + h * a3
    a4 = _acceleration(a, solenoid, x4, v4, opener_to, closer_to)
    return (
        x + h * (v + 2.0 * (v2 + v3) + v4) / 6.0,
        v + h * (a1 + 2.0 * (a2 + a3) + a4) / 6.0,
    )


@njit(cache=True)
def _acceleration(
    a: Armature, solenoid: Magnetics, x: float, v: float, i_o: float, i_c: float
) -> float:
    # a trial step may leave the travel: the force is that at the seat
    inside = min(max(x, -a.travel), a.travel)
    pull = net_force(a, solenoid, solenoid, inside, i_o, i_c)
    return (pull - a.spring * (x - inside) - rubbing(a, v)) / a.mass


@dataclass(frozen=True, slots=True)
class Rubbing:
    """What flights say of Coulomb friction.

    Attributes
    ----------
    friction, error : float
        Coulomb friction, of either sign, and its standard error [N].
    values : (3,) array
        Spring rate [N/m], damping [N s/m] and magnet force [N] with it.
    slopes : (3,) array
        What another newton of it changes in them [their units over N].
    """

    friction: float
    error: float
    values: FloatArray
    slopes: FloatArray


@dataclass(frozen=True, slots=True)
class FlightFit:
    """Fitted flights of a cycle.

    Attributes
    ----------
    strokes : tuple of Stroke
        The flights.
    values : (3,) array
        Spring rate [N/m], damping [N s/m], magnet force [N], with the options' Coulomb friction.
    rubbing : Rubbing
        The same where Coulomb friction is sought, too.
    condition : float
        Condition number of the column-scaled sensitivities.
    rms : float
        Root mean square of the residuals [m].
    seating : tuple of float
        Speed at the seat of each flight [m/s], NaN for one that did not land.
    used : int
        Samples fitted.
    unknowns, jacobian : (U,), (M, U) arrays
        All that was sought, shared and of the flights, and the sensitivities of the residuals.
    """

    strokes: tuple[Stroke, ...]
    values: FloatArray
    rubbing: Rubbing
    condition: float
    rms: float
    seating: tuple[float, ...]
    used: int
    unknowns: FloatArray
    jacobian: FloatArray


@dataclass(frozen=True, slots=True)
class Flights:
    """Record of a cycle: position (N,) [m], currents (N,) [A], usable (N,), period [s]."""

    position: FloatArray
    opener: FloatArray
    closer: FloatArray
    known: BoolArray
    period_s: float


def fit_flights(
    record: Flights, strokes: list[Stroke], a: Armature, solenoid: Magnetics
) -> FlightFit | None:
    """Fit all flights of a cycle together; None where they say too little.

    Parameters
    ----------
    record : Flights
        The cycle.
    strokes : list of Stroke
        Its flights.
    a, solenoid : Armature, Magnetics
        What is known, and where the search of the rest starts.
    """
    strokes = [s for s in strokes if np.count_nonzero(record.known[s.first : s.fitted]) >= _FEWEST]
    strokes = strokes[:_MOST_STROKES]
    if not strokes:
        return None
    problem = FlightProblem(record, strokes, a, solenoid)
    found = problem.solve(problem.start())
    if not np.isfinite(found.x).all():
        return None
    return FlightFit(
        strokes=tuple(strokes),
        values=np.asarray(found.x[:3]),
        rubbing=problem.with_coulomb(found.x),
        condition=column_condition(np.asarray(found.jac)),
        rms=float(np.sqrt(2.0 * found.cost / max(len(found.fun) - len(found.x), 1))),
        seating=tuple(problem.seating(found.x, k) for k in range(len(strokes))),
        used=len(found.fun),
        unknowns=np.asarray(found.x),
        jacobian=np.asarray(found.jac),
    )


@dataclass(frozen=True, slots=True)
class FlightProblem:
    """Residuals of all flights over what is sought: 3 or 4 shared, 2 of each flight."""

    record: Flights
    strokes: list[Stroke]
    a: Armature
    solenoid: Magnetics
    frees_coulomb: bool = False

    @property
    def shared(self) -> int:
        """How many unknowns all flights share."""
        return 4 if self.frees_coulomb else 3

    def solve(self, start: FloatArray) -> OptimizeResult:
        """Return the least squares from a start (U,).

        By SciPy: `minimise` stops short in the valley between spring and friction of one of 16
        valves whose spring had aged, and all was withheld.
        """
        from scipy.optimize import least_squares  # slow to import

        lower = np.full(len(start), -np.inf)
        lower[:3] = 0.0
        return least_squares(
            self.residuals,
            start,
            bounds=(lower, np.inf),
            x_scale=self.scale(),
            xtol=1e-10,
            ftol=1e-12,
            gtol=1e-12,
            max_nfev=50,
        )

    def with_coulomb(self, found: FloatArray) -> Rubbing:
        """Return the least squares in which Coulomb friction is sought, too, of either sign."""
        free = replace(self, frees_coulomb=True)
        best = free.solve(np.insert(found, 3, self.a.coulomb + _COULOMB_START))
        freedom = max(len(best.fun) - len(best.x), 1)
        covariance = np.linalg.pinv(best.jac.T @ best.jac) * (2.0 * best.cost / freedom)
        error = float(np.sqrt(covariance[3, 3]))
        slopes = covariance[:3, 3] / max(error**2, 1e-300)
        return Rubbing(float(best.x[3]), error, np.asarray(best.x[:3]), slopes)

    def start(self) -> FloatArray:
        """Return where the search starts (U,)."""
        parts = [self.a.spring, self.a.damping, self.solenoid.magnet_force]
        for s in self.strokes:
            part = slice(s.first, min(s.first + 8, s.end))
            good = self.record.known[part]
            t = np.arange(len(good))[good] * self.record.period_s
            line = np.polynomial.polynomial.polyfit(t, self.record.position[part][good], 1)
            parts += [float(line[0]), float(line[1])]
        return np.array(parts)

    def scale(self) -> FloatArray:
        """Return how large the unknowns are (U,)."""
        own = [1e-5, 1e-2] * len(self.strokes)
        return np.array([1e3, 0.3, 10.0, 1.0][: self.shared] + own)

    def _with(self, p: FloatArray) -> tuple[Armature, Magnetics]:
        moving = self.a._replace(spring=float(p[0]), damping=float(p[1]))
        if self.frees_coulomb:
            moving = moving._replace(coulomb=float(p[3]))
        return moving, self.solenoid._replace(magnet_force=max(float(p[2]), 0.0))

    def flight(self, p: FloatArray, k: int) -> FloatArray:
        """Return position [m] and speed [m/s] in the samples of a flight (N, 2).

        Parameters
        ----------
        p : (U,) array
            What is sought [unit of each].
        k : int
            Index of the flight.
        """
        return self._flown(p, k, self._with(p))

    def _flown(self, p: FloatArray, k: int, moving: tuple[Armature, Magnetics]) -> FloatArray:
        s = self.strokes[k]
        out = np.empty((s.fitted - s.first, 2))
        first = self.shared + 2 * k
        start = (float(p[first]), float(p[first + 1]))
        part = slice(s.first, s.fitted)
        opener, closer = self.record.opener[part], self.record.closer[part]
        fly(*moving, start, opener, closer, self.record.period_s, out)
        return out

    def residuals(self, p: FloatArray) -> FloatArray:
        """Return measured minus simulated positions of all flights (M,) [m]."""
        parts, moving = [], self._with(p)
        for k, s in enumerate(self.strokes):
            part = slice(s.first, s.fitted)
            off = self.record.position[part] - self._flown(p, k, moving)[:, 0]
            parts.append(off[self.record.known[part]])
        away = np.concatenate(parts)
        return away if np.isfinite(away).all() else np.nan_to_num(away, nan=1.0)

    def seating(self, p: FloatArray, k: int) -> float:
        """Return the speed with which the fitted flight reaches its seat."""
        s = self.strokes[k]
        if not s.landed:
            return float("nan")
        a, solenoid = self._with(p)
        x, v = (float(value) for value in self.flight(p, k)[-1])
        h = self.record.period_s / _SUBSTEPS
        opener, closer = (self._onward(i, s) for i in (self.record.opener, self.record.closer))
        for step in range(_STEPS_TO_SEAT):
            o, c = opener[step : step + 2], closer[step : step + 2]
            before = (x, v)
            x, v = advance(a, solenoid, x, v, o[0], o[1], c[0], c[1], h)
            if abs(x) >= a.travel:
                share = (a.travel - abs(before[0])) / max(abs(x) - abs(before[0]), 1e-300)
                return abs(before[1] + share * (v - before[1]))
        return float("nan")

    @staticmethod
    def _onward(current: FloatArray, s: Stroke) -> list[float]:
        """Return a current on the way from the last sample fitted to the seat [A].

        A hard contact changes it: the samples after it are not used, it goes on as the last two.
        """
        last, steps = s.fitted - 1, np.arange(_STEPS_TO_SEAT + 1) / _SUBSTEPS
        if s.fitted > s.end:
            values: FloatArray = np.interp(last + steps, np.arange(len(current)), current)
        else:
            values = current[last] + steps * (current[last] - current[last - 1])
        return [float(value) for value in values]
