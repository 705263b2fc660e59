# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the double-solenoid valve publishes, and its options."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.diagnosis.features import ESTIMATOR as FEATURES
from valve_twin.core.quantity import quantity, replaced, setting
from valve_twin.core.types import Parameter
from valve_twin.core.valves.double_solenoid.dimensions.published import ESTIMATOR as DIMENSIONS
from valve_twin.core.valves.double_solenoid.dimensions.published import PUBLISHED
from valve_twin.core.valves.double_solenoid.eddies import EddyConfig
from valve_twin.core.valves.double_solenoid.numbers import DoubleSolenoidNumbers
from valve_twin.core.valves.double_solenoid.plant import DoubleSolenoidPlant
from valve_twin.core.valves.interface import ModelOptions
from valve_twin.core.valves.kit.tolerances import Tolerated, tolerance_section, tolerated

if TYPE_CHECKING:
    from collections.abc import Mapping

ESTIMATOR = "balance"

PARAMETERS = (
    Parameter(
        "resistance_a",
        "ohm",
        "coil A, from its flux balance",
        0.0,
        trend=True,
        sided=("resistance", "a"),
    ),
    Parameter(
        "resistance_b",
        "ohm",
        "coil B, from its flux balance",
        0.0,
        trend=True,
        sided=("resistance", "b"),
    ),
    Parameter(
        "force_gain",
        "1",
        "magnetic force over that of the characteristic curves",
        0.0,
        trend=True,
        resolution=5e-4,  # ripple of the currents, whose squares a mean does not hold
    ),
    Parameter(
        "friction",
        "N",
        "Coulomb friction peak to peak (F_h of paper 000)",
        0.0,
        trend=True,
        resolution=3e-3,  # as above, of 6 N
    ),
    Parameter(
        "preload_1", "N", "spring 1 in the middle, spring 2 as in the options", 0.0, trend=True
    ),
    Parameter(
        "eddies.gain_1", "A/V", "faster eddy current, by the flux balance; with eddies", 0.0
    ),
    Parameter("eddies.time_1", "s", "its time, likewise", 0.0),
    Parameter("eddies.gain_2", "A/V", "slower eddy current, likewise", 0.0),
    Parameter("eddies.time_2", "s", "its time, likewise", 0.0),
    *PUBLISHED,
)
NAMES = tuple(p.name for p in PARAMETERS if p.trend)
EDDIES = "eddies."
BRANCHES = ("gain_1", "time_1", "gain_2", "time_2")
"""Numbers of the eddy branches, which a cycle tells within the tolerances of the options."""
COILS = NAMES[:2]
MECHANICAL = NAMES[2:]


EddyTolerances = tolerance_section(
    "EddyTolerances",
    __name__,
    EddyConfig,
    {"gain_1": 0.05, "time_1": 0.05, "gain_2": 0.05, "time_2": 0.05, "growth": 0.05},
)


_KnownTolerances = tolerance_section(
    "_KnownTolerances",
    __name__,
    DoubleSolenoidNumbers,
    {
        "mass": 0.01,
        "spring_1": 0.02,
        "spring_2": 0.02,
        "preload_2": 0.02,
        "alpha": 0.1,
        "beta": 0.05,
        "half_stroke": 0.005,
        "turns": 0.01,
        "pole_area": 0.02,
        "gap": 0.02,
        "saturation_flux": 0.02,
        "coupling": 0.1,
        "supply_voltage": 0.01,
        "current_scale": 0.005,
    },
)


@dataclass(frozen=True, slots=True)
class DoubleSolenoidTolerances(_KnownTolerances):  # type: ignore[misc,valid-type]
    """Half widths of the known constants, in parts of their values."""

    eddies: object = field(default_factory=EddyTolerances)


@dataclass(frozen=True, slots=True)
class DoubleSolenoidOptions(DoubleSolenoidNumbers, ModelOptions):
    """The numbers of the data sheet: what is not estimated has to be known."""

    estimators: tuple[str, ...] = setting(
        (ESTIMATOR,), "estimators to run", choices=(ESTIMATOR, FEATURES, DIMENSIONS)
    )
    dimension_names: tuple[str, ...] = setting(
        (), "Worn dimensions that the estimator `dimensions` knows, by `design export --faults`"
    )
    dimension_current: tuple[float, ...] = quantity(
        (), "A", "Currents at which their changes of the coenergy stand, from 0"
    )
    dimension_position: tuple[float, ...] = quantity((), "m", "Positions of the same")
    dimension_coenergy: tuple[float, ...] = quantity(
        (), "J", "Changes for a size of 1: coefficients of splines, a dimension after the other"
    )
    map_doubt_names: tuple[str, ...] = setting(
        (), "What map_coenergy is in doubt about, by `design export --doubts`"
    )
    map_doubt: tuple[float, ...] = quantity(
        (), "J", "Changes of map_coenergy by a standard deviation, a doubt after the other"
    )
    tolerances: object = field(default_factory=DoubleSolenoidTolerances)


def known_valve(
    options: DoubleSolenoidOptions, values: Mapping[str, float]
) -> DoubleSolenoidPlant:
    """Return the valve of the options, with `values` by dotted name in their place.

    Raises
    ------
    ValueError
        If a number is outside its range or does not fit the others; it names the number.
    """
    given = {f.name: getattr(options, f.name) for f in fields(DoubleSolenoidNumbers)}
    given |= {name: value for name, value in values.items() if name in given}
    inside = {n.removeprefix(EDDIES): v for n, v in values.items() if n.startswith(EDDIES)}
    if inside:
        given["eddies"] = replaced(options.eddies, inside)
    return DoubleSolenoidPlant(**given)


def constants_of(options: DoubleSolenoidOptions) -> Tolerated:
    """Return the constants that are not known exactly; eddy currents only where there are any."""
    found = tolerated(options)
    if options.eddies.gain_1:
        return found
    kept = [k for k, name in enumerate(found.names) if not name.startswith(EDDIES)]
    return Tolerated(tuple(found.names[k] for k in kept), found.widths[kept])


def doubted(options: DoubleSolenoidOptions) -> list[DoubleSolenoidOptions]:
    """Return the options with each doubt about the map added to it, by a standard deviation.

    Raises
    ------
    ValueError
        If the lists of the doubts do not fit each other or the map.
    """
    own, names = np.array(options.map_coenergy), options.map_doubt_names
    found, wanted = len(options.map_doubt), len(names) * len(own)
    message = ""
    if names and not len(own):
        message = "map_doubt_names: there is no map_coenergy to be in doubt about"
    elif found != wanted:
        message = f"map_doubt: {found} values, {len(names)} doubts of {len(own)} need {wanted}"
    elif not np.isfinite(options.map_doubt).all():
        message = "map_doubt: a value is not finite"
    if message:
        raise ValueError(f"{message}; copy what `design export --doubts` writes")  # noqa: EM102
    changes = np.array(options.map_doubt).reshape(len(names), len(own))
    return [replace(options, map_coenergy=tuple((own + c).tolist())) for c in changes]
