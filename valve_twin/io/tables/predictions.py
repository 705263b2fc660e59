# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Write what the twin predicts of a bag, sample by sample, as a table."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.prediction import fit_percent
from valve_twin.core.types import Prediction, Validity
from valve_twin.io.offline.run import estimate_bag
from valve_twin.io.tables.csv_export import STAMP, Table, check_format, write_table

if TYPE_CHECKING:
    from valve_twin.core.types import BoolArray
    from valve_twin.io.config.valve import ValveConfig
    from valve_twin.io.tables.csv_export import Cell

COLUMNS = (
    STAMP,
    "cycle",
    "measured",
    "one_step",
    "free_run",
    "residual",
    "residual_sigma",
    "validity",
    "reproducible",
)
"""Of the table; residual = measured - one_step, positions in the unit of the model."""

_LEAST = 10  # samples of a cycle by which an error is judged


@dataclass(frozen=True, slots=True)
class CycleError:
    """How far the predictions of one cycle were off; each is of a model that does not know it.

    Attributes
    ----------
    cycle : int
        Its number.
    frozen : bool
        Whether the model had stopped learning before it.
    one_step_rmse : float
        Root mean square of the one-step residual over valid samples [1]; NaN = too few.
    free_run_fit : float
        Fit of the free run, 100 = perfect, 0 = the mean [%]; NaN = too few.
    """

    cycle: int
    frozen: bool
    one_step_rmse: float
    free_run_fit: float


def write_predictions(
    config: ValveConfig, bag: str | Path, out: str | Path, *, freeze_after: int = 0
) -> tuple[CycleError, ...]:
    """Predict every sample of a bag as the live twin does and write a row each.

    Parameters
    ----------
    config : ValveConfig
        The valve's configuration.
    bag : path
        Folder, metadata.yaml or .mcap file.
    out : path
        File to write, .csv or .parquet.
    freeze_after : int
        The cycle after which the model learns nothing more; 0 = it always learns.

    Returns
    -------
    tuple of CycleError
        One a cycle with valid predictions, in order.

    Raises
    ------
    BagError
        If the bag cannot be read or the table cannot be written.
    ConfigError
        If the configuration does not fit.
    """
    check_format(out)
    parts = [
        event
        for event in estimate_bag(config, bag, freeze_after=freeze_after)
        if isinstance(event, Prediction)
    ]
    write_table(_table(parts), Path(out))
    by_cycle: dict[int, list[Prediction]] = {}
    for part in parts:
        by_cycle.setdefault(part.cycle, []).append(part)
    errors = [
        cycle_error(number, of, frozen=0 < freeze_after < number)
        for number, of in by_cycle.items()
        if number
    ]
    return tuple(e for e in errors if math.isfinite(e.one_step_rmse))


def cycle_error(cycle: int, parts: list[Prediction], *, frozen: bool) -> CycleError:
    """Return the errors of one cycle's predictions.

    Parameters
    ----------
    cycle : int
        Its number.
    parts : list of Prediction
        In their order.
    frozen : bool
        Whether the model had stopped learning.
    """
    valid: BoolArray = np.concatenate([p.validity == Validity.VALID for p in parts])
    residual = np.concatenate([p.residual for p in parts])[valid]
    measured = np.concatenate([p.measured for p in parts])
    free = np.concatenate([p.simulated for p in parts])
    both = np.isfinite(measured) & np.isfinite(free)
    rmse = float(np.sqrt(np.mean(residual**2))) if len(residual) >= _LEAST else math.nan
    return CycleError(cycle, frozen, rmse, fit_percent(measured[both], free[both], least=_LEAST))


def _table(parts: list[Prediction]) -> Table:
    columns: dict[str, list[Cell]] = {name: [] for name in COLUMNS}
    words = [v.name.lower() for v in Validity]
    for part in parts:
        count = len(part.stamp_ns)
        rows: tuple[list[Cell], ...] = (
            part.stamp_ns.tolist(),
            [part.cycle] * count,
            part.measured.tolist(),
            part.predicted.tolist(),
            part.simulated.tolist(),
            part.residual.tolist(),
            [part.residual_sigma] * count,
            [words[v] for v in part.validity.tolist()],
            [part.reproducible] * count,
        )
        for name, cells in zip(COLUMNS, rows, strict=True):
            columns[name] += cells
    return Table(columns)
