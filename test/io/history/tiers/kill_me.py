# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A program to be killed: a child a line of stdin condenses all but so many cycles.

The first line of a child is its process id, the second whether it was killed or had ended.
"""

import os
import sys

from valve_twin.io.history.store import History
from valve_twin.io.history.tiers import condense as module
from valve_twin.io.history.tiers.retention import Retention


def condense_all_but(cycles: int, path: str) -> None:
    module.LEAST, module.A_TIME = 100, 150
    sys.stdout.write(f"{os.getpid()}\n")
    sys.stdout.flush()
    with History(path) as history:
        module.condense(history, "/v", Retention(cycles=cycles))


if __name__ == "__main__":
    for line in sys.stdin:
        child = os.fork()
        if child == 0:
            condense_all_but(int(line), sys.argv[1])
            os._exit(0)
        _, status = os.wait()
        sys.stdout.write("killed\n" if os.WIFSIGNALED(status) else "ended\n")
        sys.stdout.flush()
