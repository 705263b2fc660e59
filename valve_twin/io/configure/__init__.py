# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""From files that nobody prepared to a configuration that runs."""
