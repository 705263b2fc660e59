# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""One file a revision; a released one is never changed."""
