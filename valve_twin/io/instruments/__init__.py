# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Files of other instruments: any table, as columns with names, units and times."""
