# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Users of a face with salted hashes of their passwords, and a brake on guessing."""

from __future__ import annotations

import hashlib
import hmac
import ipaddress
import os
import re
import time
from collections import OrderedDict, deque
from pathlib import Path
from typing import TYPE_CHECKING

from valve_twin.io.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

TRIES = 5
"""Wrong passwords of a name from one place before it is refused unheard there until `PAUSE_S`
after the first [1]."""

PAUSE_S = 30.0
"""How long [s]."""

MOST_PLACES = 2000
"""Names at places whose wrong passwords are kept; of more the oldest go [1]."""

_NETWORK = 64
"""Of an address of IPv6 so many bits are one place: who has one has all of them [1]."""

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

    It is refused to the place that has tried, so that nobody shuts out its owner elsewhere.

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
        self._wrong: OrderedDict[tuple[str, str], deque[float]] = OrderedDict()

    def replace(self, users: Mapping[str, tuple[str, str]]) -> None:
        """Take other users from now on; who is refused stays so."""
        self._users = dict(users)

    def line(self, name: str) -> tuple[str, str] | None:
        """Return salt and hash of a user; None where there is none of the name."""
        return self._users.get(name)

    def fits(self, name: str, password: str, address: str = "") -> bool:
        """Return whether a user may come in; names that do not exist share one brake.

        Parameters
        ----------
        name, password : str
            What he says.
        address : str
            From where; empty where the face cannot tell.
        """
        known = name in self._users
        place = _place(address)
        key = place, name if known else ""
        wrong = self._wrong.pop(key, None) or deque(maxlen=TRIES)
        self._wrong[key] = wrong
        while len(self._wrong) > MOST_PLACES:
            self._wrong.popitem(last=False)
        now = self._clock()
        if len(wrong) == TRIES and now - wrong[0] < PAUSE_S:
            return False
        salt, expected = self._users.get(name, _NOBODY)
        found = hashed(password, bytes.fromhex(salt)).hex()
        if hmac.compare_digest(found, expected) and known:
            del self._wrong[key]
            return True
        wrong.append(now)
        if len(wrong) == TRIES and now - wrong[0] < PAUSE_S:
            who = f"user {name}" if known else "users that do not exist"
            there = f" from {place}" if place else ""
            self._tell(
                f"{self._where}: {TRIES} wrong passwords of {who}{there}: refused for "
                f"{PAUSE_S:.0f} s"
            )
        return False


def _place(address: str) -> str:
    """Return what counts as one place: an address, or the network of one of IPv6."""
    try:
        found = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return address
    if isinstance(found, ipaddress.IPv4Address):
        return str(found)
    if found.ipv4_mapped is not None:
        return str(found.ipv4_mapped)
    return str(ipaddress.ip_network((found, _NETWORK), strict=False))
