# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Service limits that the scatter of the estimates supports: never one inside it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.aging.config import AgingConfig
from valve_twin.core.twin import Estimated
from valve_twin.core.types import EstimateStatus
from valve_twin.core.valves.registry import get_model
from valve_twin.io.config.valve import load_config
from valve_twin.io.instruments.into_bag import import_recordings
from valve_twin.io.offline.run import estimate_bag
from valve_twin.io.whole import write_whole

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.types import FloatArray

LEAST_CYCLES = 10
"""Accepted estimates from which scatter is known, as for a reference."""

MOST_CYCLES = 20
"""Cycles that are estimated: it bounds the time, assumed."""

_TIMES = 5.0  # standard deviations of a single cycle that a limit lies away, assumed
_STEP = 5.0  # limits are rounded up to that [%]
_MOST = 60.0  # a limit farther away would say nothing, assumed [%]


@dataclass(frozen=True, slots=True)
class Limit:
    """A service limit of one parameter, or why there is none.

    Attributes
    ----------
    parameter : str
        Its name.
    percent : float
        Change against the reference [%]; NaN = none.
    reason : str
        What it rests on.
    """

    parameter: str
    percent: float
    reason: str


def justified_limits(
    text: str, files: Sequence[Path], count: float = math.inf, *, own: bool = True
) -> list[Limit]:
    """Estimate the first cycles of files and return a limit a parameter that is followed.

    Parameters
    ----------
    text : str
        The proposed configuration.
    files : sequence of path
        What it was proposed for.
    count : float
        About how many cycles these hold [1]: too few are not estimated.
    own : bool
        Whether what the model follows by default is meant, too, not only what its options add.

    Returns
    -------
    list of Limit
        In the order of the model; empty where it follows nothing.

    Raises
    ------
    BagError
        If no file can be imported.
    """
    with TemporaryDirectory(prefix="valve_twin_") as folder:
        written = Path(folder, "valve.yaml")
        write_whole(written, text)
        config = load_config(written)[0]
        model = get_model(config.model)
        followed = [p.name for p in model.parameters if p.trend and own]
        followed += model.also_followed(config.options)
        if count < LEAST_CYCLES:
            why = f"none: {count:.0f} cycles, {LEAST_CYCLES} tell the scatter"
            return [Limit(name, math.nan, why) for name in followed]
        import_recordings(files, config, Path(folder, "bag"))
        found: dict[str, list[float]] = {name: [] for name in followed}
        cycles = 0
        for event in estimate_bag(config, Path(folder, "bag")):
            if not isinstance(event, Estimated):
                continue
            cycles += 1
            for estimate in event.estimates:
                if not estimate.used_by_trend or estimate.status is EstimateStatus.REFUSED:
                    continue
                for p in estimate.parameters:
                    if p.usable and p.name in found:
                        found[p.name].append(p.value)
            if cycles >= MOST_CYCLES:
                break
    return [limit_of(name, np.array(values)) for name, values in found.items()]


def limit_of(parameter: str, values: FloatArray) -> Limit:
    """Return the least limit that lies outside the scatter and is no less than the usual one.

    Parameters
    ----------
    parameter : str
        Its name.
    values : (N,) array
        Accepted estimates in their order [unit of the parameter].
    """
    n = len(values)
    if n < LEAST_CYCLES:
        return Limit(parameter, math.nan, f"none: {n} estimates, {LEAST_CYCLES} tell the scatter")
    centre = float(np.median(values))
    spread = max(float(np.std(values, ddof=1)), float(np.max(np.abs(values - centre))) / 3.0)
    if spread == 0.0 or abs(centre) * _MOST < 100.0 * spread:
        why = "does not vary at all" if spread == 0.0 else "scatters about 0"
        return Limit(parameter, math.nan, f"none: it {why}, so a change in percent says nothing")
    percent = 100.0 * spread / abs(centre)
    least = max(AgingConfig().default_percent, _STEP * math.ceil(_TIMES * percent / _STEP))
    if least > _MOST:
        return Limit(parameter, math.nan, f"none: single cycles scatter by {percent:.2g} %")
    return Limit(
        parameter, least, f"single cycles scatter by {percent:.2g} % ({n} cycles); confirm it"
    )
