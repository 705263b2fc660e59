# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Dynamics that eddy currents add to static curves: G_A from flux to current, G_F of the force."""

from valve_twin.design.dynamics.identify import Dynamics, fit_dynamics, identify
from valve_twin.design.dynamics.replay import Replay, replay

__all__ = ["Dynamics", "Replay", "fit_dynamics", "identify", "replay"]
