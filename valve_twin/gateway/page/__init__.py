# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the pages need beside what they show: words, accounts, marks, samples of cycles."""
