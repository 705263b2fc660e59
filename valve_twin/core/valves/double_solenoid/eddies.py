# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Eddy currents of a coil in two branches, the next order after G_A and G_F of paper 000.

    i = i_m + e_1 + e_2      i_m = i_s(psi, i_other, x)      t_j e_j' = k_j psi' - e_j
    F = g F_s(i_mA, i_mB, x)      k_j = gain_j (1 + growth i_m)

The force follows from the flux, through the currents that magnetise, without a filter of its own;
the voltage that drives an eddy current is that of the coil, whatever iron and gap are. With a
growth, the next order, a coil that is magnetised more has the larger eddy currents.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from valve_twin.core.control.current_loop import SAMPLE_S
from valve_twin.core.quantity import QuantityError, assumed, check_quantities
from valve_twin.kernels import njit

_LEAST = 0.1  # of what a growth may leave of the current that magnetises [1], assumed


class Eddies(NamedTuple):
    """Gains [A/V], rates [1/s], growth [1/A] for compiled functions; gain_1 = 0 = none."""

    gain_1: float
    rate_1: float
    gain_2: float
    rate_2: float
    growth: float


@dataclass(frozen=True, slots=True)
class EddyConfig:
    """Numbers of the branches."""

    gain_1: float = assumed(
        0.0, "A/V", "Eddy currents, faster branch; 0 = G_A and G_F apply", 0.0, 10.0, ages=False
    )
    time_1: float = assumed(4e-4, "s", "Time of the faster branch", 1e-4, 1.0, ages=False)
    gain_2: float = assumed(0.0, "A/V", "Slower branch; needs gain_1", 0.0, 10.0, ages=False)
    time_2: float = assumed(8e-3, "s", "Time of the slower branch", 1e-4, 1.0, ages=False)
    growth: float = assumed(
        0.0, "1/A", "Growth of both gains with the current that magnetises the coil", 0.0, 100.0,
        ages=False,
    )  # fmt: skip

    def __post_init__(self) -> None:
        """Refuse values outside their range, and a slower branch alone."""
        check_quantities(self)
        if self.gain_2 and not self.gain_1:
            refusal = f"gain_2 = {self.gain_2!r}: needs gain_1 above 0 [A/V]"
            raise QuantityError(type(self).__name__, refusal)

    def check_resistance(self, resistance: float, largest: float) -> None:
        """Refuse branches that Euler at 80 kHz cannot follow in a coil.

        Parameters
        ----------
        resistance : float
            Of the coil: its drop at an eddy current brakes the flux that drives it [ohm].
        largest : float
            Current to which the gains may grow [A].
        """
        braked = resistance * (1.0 + self.growth * largest)
        one, two = (
            (1.0 + gain * braked) / time
            for gain, time in ((self.gain_1, self.time_1), (self.gain_2, self.time_2))
        )
        both = (1.0 + (self.gain_1 + self.gain_2) * braked) / (self.time_1 * self.time_2)
        half = 0.5 * (one + two)
        fastest = 1.0 / (half + math.sqrt(max(half * half - both, 0.0)))
        if fastest < SAMPLE_S / 4.0:
            refusal = (
                f"gain_1 = {self.gain_1!r}, gain_2 = {self.gain_2!r}, growth = {self.growth!r}: "
                f"the fastest time at {resistance:g} ohm and {largest:g} A is {fastest:.3g} s; "
                f"must be {SAMPLE_S / 4.0:g} s or longer for steps of 12.5 us: lower gains or "
                "longer times"
            )
            raise QuantityError(type(self).__name__, refusal)

    def numbers(self) -> Eddies:
        """Return the numbers for the compiled functions."""
        gains = float(self.gain_1), float(self.gain_2)
        rates = 1.0 / self.time_1, 1.0 / self.time_2
        return Eddies(gains[0], rates[0], gains[1], rates[1], float(self.growth))


@njit(cache=True, inline="always")
def driving(of: Eddies, magnetises: float, induced: float) -> float:
    """Return the voltage that drives the eddy currents of a coil as its gains have grown [V].

    Parameters
    ----------
    of : Eddies
        The branches.
    magnetises : float
        Current that magnetises the coil [A].
    induced : float
        d psi/dt of the coil [V].
    """
    return induced * (1.0 + of.growth * max(magnetises, 0.0))


@njit(cache=True, inline="always")
def step_branches(
    of: Eddies, fast: float, slow: float, induced: float, step_s: float
) -> tuple[float, float]:
    """Return the eddy currents of a coil after an explicit step [A].

    Parameters
    ----------
    of : Eddies
        The branches.
    fast, slow : float
        Their currents before [A].
    induced : float
        d psi/dt of the coil [V], see `driving`.
    step_s : float
        The step [s].
    """
    return (
        fast + step_s * of.rate_1 * (of.gain_1 * induced - fast),
        slow + step_s * of.rate_2 * (of.gain_2 * induced - slow),
    )


@njit(cache=True)
def magnetising(
    of: Eddies, drawn: float, induced: float, fast: float, slow: float, period_s: float
) -> tuple[float, float, float]:
    """Return the current that magnetises a coil in a sample, and its eddy currents after it [A].

    Exact for a voltage that is constant within the sample; the gains are those of the mean.

    Parameters
    ----------
    of : Eddies
        The branches.
    drawn, induced : float
        Measured current [A] and d psi/dt [V], means over the sample.
    fast, slow : float
        Eddy currents before it [A].
    period_s : float
        The sample [s].
    """
    left_1, left_2 = math.exp(-period_s * of.rate_1), math.exp(-period_s * of.rate_2)
    drives = induced
    if of.growth > 0.0:
        kept_1 = (1.0 - left_1) / (period_s * of.rate_1)
        kept_2 = (1.0 - left_2) / (period_s * of.rate_2)
        risen = induced * (of.gain_1 * (1.0 - kept_1) + of.gain_2 * (1.0 - kept_2))
        # the mean is `rest` less `risen` times its growth, hence
        rest = drawn - kept_1 * fast - kept_2 * slow - risen
        drives = driving(of, rest / max(1.0 + of.growth * risen, _LEAST), induced)
    end_1, end_2 = of.gain_1 * drives, of.gain_2 * drives
    mean_1 = end_1 + (fast - end_1) * (1.0 - left_1) / (period_s * of.rate_1)
    mean_2 = end_2 + (slow - end_2) * (1.0 - left_2) / (period_s * of.rate_2)
    return (
        drawn - mean_1 - mean_2,
        end_1 + (fast - end_1) * left_1,
        end_2 + (slow - end_2) * left_2,
    )
