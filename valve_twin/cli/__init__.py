# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The offline face of the core: `valve-twin VERB`, one module a verb.

Exit codes: 0 ok, 1 the data or a check failed, 2 wrong usage. Errors are one line on stderr.
"""

import valve_twin.one_thread  # noqa: F401 - before numpy
from valve_twin.cli.main import main

__all__ = ["main"]
