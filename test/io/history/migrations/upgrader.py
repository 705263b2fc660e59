# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Programs that open a history of an older schema, as a twin does, and may die of it.

Each line of stdin holds as JSON: path or URL; number of the statement of the upgrade at which it
is killed, 0 = none; largest file that it may write [B], 0 = any; how many programs open it at
once. The answer is a line: for each its exit code and what it said.
"""

import json
import os
import resource
import signal
import sys

import sqlalchemy as sa

import valve_twin.io.history.migrations.schema  # noqa: F401
from valve_twin.io.errors import StoreError
from valve_twin.io.history.store import History


def kill_at(last: int) -> None:
    """Kill this process before so many statements since the upgrade began."""
    seen = 0

    def count(_connection, _cursor, statement, *_more):
        nonlocal seen
        if seen or statement.startswith("ALTER"):
            seen += 1
            if seen == last:
                os.kill(os.getpid(), signal.SIGKILL)

    sa.event.listen(sa.Engine, "before_cursor_execute", count)


def opened(url: str, last: int, largest: int) -> str:
    if last:
        kill_at(last)
    if largest:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (largest, largest))
    try:
        with History(url) as history:
            return str(sum(len(history.cycles(v)) for v in history.valves()))
    except StoreError as err:
        return f"refused: {err}"


def begin(url: str, last: int, largest: int) -> tuple[int, int]:
    """Start a program; return its number and where it will say what it found."""
    said, says = os.pipe()
    child = os.fork()
    if not child:
        code = 1
        try:
            os.write(says, opened(url, last, largest).encode())
            code = 0
        except Exception as err:
            os.write(says, f"{type(err).__name__}: {err}".encode())
        finally:
            os._exit(code)
    os.close(says)
    return child, said


if __name__ == "__main__":
    for line in sys.stdin:
        url, last, largest, count = json.loads(line)
        answers = []
        for child, said in [begin(url, last, largest) for _ in range(count)]:
            _, status = os.waitpid(child, 0)
            with os.fdopen(said) as text:
                answers.append((os.waitstatus_to_exitcode(status), text.read()))
        sys.stdout.write(json.dumps(answers) + "\n")
        sys.stdout.flush()
