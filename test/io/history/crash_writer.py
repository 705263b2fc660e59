# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A program to be killed: a child a line of stdin stores cycles until it is killed.

The first line of a child is its process id, every other the number of a cycle that the history
acknowledged.
"""

import os
import sys

from valve_twin.core.types import Estimate, EstimateStatus, ParameterValue
from valve_twin.io.history.store import CycleRecord, History

VALVE = "/press/valve_1"


def estimates(number: int) -> list[Estimate]:
    values = (ParameterValue("K_in", 0.05 * number), ParameterValue("leak", 1.0 / number))
    return [
        Estimate(
            "press_cartridge",
            name,
            number,
            number,
            number + 1,
            values,
            EstimateStatus.ACCEPTED,
            "",
        )
        for name in ("output_error", "equation_error_qp4")
    ]


def store_until_killed(path: str) -> None:
    sys.stdout.write(f"{os.getpid()}\n")
    sys.stdout.flush()
    history = History(path)
    number = history.last_cycle(VALVE)
    while True:
        number += 1
        history.store(
            VALVE, CycleRecord(number, number, number + 1, samples=1000), estimates(number)
        )
        sys.stdout.write(f"{number}\n")
        sys.stdout.flush()


if __name__ == "__main__":
    for _ in sys.stdin:
        if os.fork() == 0:
            store_until_killed(sys.argv[1])
        os.wait()
        sys.stdout.write("ended\n")
        sys.stdout.flush()
