# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""One cycle from the outside: is it plausible, what do its estimators say, how do they scatter."""
