# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The past of one valve as columns: what trends and faults read of its estimates."""
