# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Users of a face with salted hashes of their passwords, and a brake on guessing."""

from __future__ import annotations

import hashlib
import hmac
import os
import re
import time
from collections import defaultdict, deque
from pathlib import Path
from typing import TYPE_CHECKING

from valve_twin.io.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

TRIES = 5
"""Wrong passwords of a name before it is refused unheard until `PAUSE_S` after the first [1]."""

PAUSE_S = 30.0
"""How long [s]."""

_COST = {"n": 2**14, "r": 8, "p": 1}
_LINE = re.compile(r"(?P<name>[^:\s][^:]*):(?P<salt>[0-9a-f]{32}):(?P<hash>[0-9a-f]{128})")
_NOBODY = "0" * 32, "0" * 128


def hashed(password: str, salt: bytes) -> bytes:
    """Return the scrypt hash of a password."""
    return hashlib.scrypt(password.encode(), salt=salt, **_COST)


def user_line(name: str, password: str) -> str:
    """Return the line of a user for the file of users.

    Raises
    ------
    ConfigError
        If the name cannot stand in it or the password is short.
    """
    if not name or ":" in name or name != name.strip() or not name.isprintable():
        msg = f"user {name!r}: no colon, no space at its ends and no control character, please"
        raise ConfigError(msg)
    if len(password) < _LEAST:
        msg = f"user {name}: the password needs {_LEAST} characters or more"
        raise ConfigError(msg)
    salt = os.urandom(16)
    return f"{name}:{salt.hex()}:{hashed(password, salt).hex()}"


_LEAST = 8


def read_users(path: str | Path, option: str = "--add-user") -> dict[str, tuple[str, str]]:
    """Return salt and hash by name from a file of lines that `user_line` made.

    Parameters
    ----------
    path : path
        The file.
    option : str
        Of `valve-twin serve`: what makes such a line.

    Raises
    ------
    ConfigError
        If it cannot be read or a line is none of a user.
    """
    try:
        lines = Path(path).read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as err:
        why = getattr(err, "strerror", None) or err
        msg = f"{path}: cannot be read: {why}: make it by valve-twin serve {option}"
        raise ConfigError(msg) from err
    found = {}
    for number, line in enumerate(lines, 1):
        if not line or line.startswith("#"):
            continue
        match = _LINE.fullmatch(line)
        if match is None:
            msg = f"{path}: line {number} is none of a user: make it by {option}"
            raise ConfigError(msg)
        found[match["name"]] = match["salt"], match["hash"]
    return found


class Passwords:
    """Checks passwords; a name that is tried too often is refused without a look for a while.

    Parameters
    ----------
    users : mapping
        Salt and hash by name.
    tell : callable
        Gets a line when a name is refused unheard.
    where : str
        The face, as it stands before that line.
    clock : callable
        Returns a time that only goes on [s].
    """

    def __init__(
        self,
        users: Mapping[str, tuple[str, str]],
        tell: Callable[[str], None],
        where: str = "OPC UA",
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._users, self._tell, self._clock = dict(users), tell, clock
        self._where = where
        self._wrong: dict[str, deque[float]] = defaultdict(lambda: deque(maxlen=TRIES))

    def replace(self, users: Mapping[str, tuple[str, str]]) -> None:
        """Take other users from now on; who is refused stays so."""
        self._users = dict(users)

    def fits(self, name: str, password: str) -> bool:
        """Return whether a user may come in; names that do not exist share one brake."""
        known = name in self._users
        wrong = self._wrong[name if known else ""]
        now = self._clock()
        if len(wrong) == TRIES and now - wrong[0] < PAUSE_S:
            return False
        salt, expected = self._users.get(name, _NOBODY)
        found = hashed(password, bytes.fromhex(salt)).hex()
        if hmac.compare_digest(found, expected) and known:
            wrong.clear()
            return True
        wrong.append(now)
        if len(wrong) == TRIES and now - wrong[0] < PAUSE_S:
            who = f"user {name}" if known else "users that do not exist"
            self._tell(
                f"{self._where}: {TRIES} wrong passwords of {who}: refused for {PAUSE_S:.0f} s"
            )
        return False
