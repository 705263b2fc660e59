# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Messages as bytes (CDR): layout, single messages, runs as columns, the signals in them."""
