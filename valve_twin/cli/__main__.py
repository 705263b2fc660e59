# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Run the command as `python -m valve_twin.cli`."""

import sys

from valve_twin.cli.main import main

sys.exit(main())
