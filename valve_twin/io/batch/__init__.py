# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Archives of many bags on all cores or several machines."""
