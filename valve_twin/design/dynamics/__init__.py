# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Dynamics that eddy currents add to static curves: G_A from flux to current, G_F of the force."""

from valve_twin.design.dynamics.eddies import Branches, branch_records, fit_branches
from valve_twin.design.dynamics.growing import Growing, fit_growing
from valve_twin.design.dynamics.identify import Dynamics, fit_dynamics, identify
from valve_twin.design.dynamics.replay import Replay, replay, step_record
from valve_twin.design.dynamics.switched import Bridge, Switched, identify_switched

__all__ = [
    "Branches",
    "Bridge",
    "Dynamics",
    "Growing",
    "Replay",
    "Switched",
    "branch_records",
    "fit_branches",
    "fit_dynamics",
    "fit_growing",
    "identify",
    "identify_switched",
    "replay",
    "step_record",
]
