# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Pictures and page of a search for a better design."""
