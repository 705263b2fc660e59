# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Fields of two coils without iron, with known branches of eddy currents, in place of a mesh."""

from __future__ import annotations

import numpy as np

from valve_twin.core.physics.coenergy import linear_map
from valve_twin.design.field.transient import Transient

OWN, MUTUAL = 0.04, -8e-3
CURVES = linear_map(OWN, MUTUAL, 2.5e-3, 4, 4)
GAINS, TIMES = (0.012, 0.035), (4e-4, 8e-3)


def answer(model, time_s, currents, position=None, method="euler", gains=GAINS):
    """Return what the branches make of given currents, implicit Euler between the times."""
    inductance = np.array([[OWN, MUTUAL], [MUTUAL, OWN]])
    rest, eddy, parts = currents[0].copy(), np.zeros((2, 2)), 20
    flux, force = np.empty_like(currents), np.empty(len(time_s))
    x = np.zeros(1)
    for n in range(len(time_s)):
        for part in range(1, parts + 1) if n else ():
            step = (time_s[n] - time_s[n - 1]) / parts
            i = currents[n - 1] + part / parts * (currents[n] - currents[n - 1])
            keep = 1.0 / (1.0 + step / np.array(TIMES))
            share = keep * np.array(gains) / np.array(TIMES)
            before = inductance @ rest
            # i = rest + sum of eddy, eddy = keep eddy + share (L rest - before)
            right = i - keep @ eddy + share.sum() * before
            rest = np.linalg.solve(np.eye(2) + share.sum() * inductance, right)
            eddy = keep[:, None] * eddy + share[:, None] * (inductance @ rest - before)
        flux[n] = inductance @ rest
        force[n] = CURVES.force(rest[None, :], x)[0]
    none = np.zeros(len(time_s))
    return Transient(time_s, currents, none, flux, force, none, none)
