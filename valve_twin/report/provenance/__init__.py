# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What a report page was made from, so that it can be made again and compared."""
