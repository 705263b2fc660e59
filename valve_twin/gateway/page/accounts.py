# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Who may mark and acknowledge from the page: sessions of users with a password."""

from __future__ import annotations

import hmac
import secrets
import threading
import time
from collections import OrderedDict
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from valve_twin.gateway.passwords import Passwords, read_users

if TYPE_CHECKING:
    from collections.abc import Callable

COOKIE = "valve_twin_session"

SESSION_S = 8 * 3600.0
"""A session ends so long after its last use: a shift [s]. That a page asks anew is no use."""

MOST_SESSIONS = 500
"""Sessions at a time; a further one ends the one that was not used for longest [1]."""

MOST_LETTERS = 1000
"""Longest name and password that are looked at [characters]."""


@dataclass(slots=True)
class Session:
    """One browser in which a user has come in.

    Attributes
    ----------
    user : str
        Who.
    token : str
        What every form of the session carries: another site does not know it.
    said : str
        What the next page is to say.
    used_s : float
        When it was used last [s].
    line : tuple of str or None
        Salt and hash of the password with which the user came in.
    """

    user: str
    token: str = field(default_factory=lambda: secrets.token_urlsafe(32))
    said: str = ""
    used_s: float = 0.0
    line: tuple[str, str] | None = None

    def owns(self, token: str) -> bool:
        """Return whether a form is one of this session."""
        return hmac.compare_digest(token.encode(), self.token.encode())


class Accounts:
    """The users of a file and their sessions; safe from any thread.

    The file is read at every login and every form: who is added may come in, who is removed or has
    another password may not go on.

    Parameters
    ----------
    path : str
        File of users, see `passwords.user_line`.
    tell : callable
        Gets a line when a name is refused unheard, and for every user that comes in.
    clock : callable
        Returns a time that only goes on [s].

    Raises
    ------
    ConfigError
        If the file cannot be read.
    """

    def __init__(
        self, path: str, tell: Callable[[str], None], clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._path, self._tell, self._clock = path, tell, clock
        self._passwords = Passwords(read_users(path), tell, "page", clock)
        self._sessions: OrderedDict[str, Session] = OrderedDict()
        self._lock = threading.Lock()
        self._guess = threading.Lock()  # one at a time: the hash is made to be slow

    def enter(self, user: str, password: str, address: str = "") -> str:
        """Return the cookie of a new session; empty where user and password do not fit.

        Parameters
        ----------
        user, password : str
            What he says.
        address : str
            From where.

        Raises
        ------
        ConfigError
            If the file of users cannot be read.
        """
        if max(len(user), len(password)) > MOST_LETTERS:
            return ""
        with self._guess:
            self._passwords.replace(read_users(self._path))
            if not self._passwords.fits(user, password, address):
                return ""
            line = self._passwords.line(user)
        with self._lock:
            while len(self._sessions) >= MOST_SESSIONS:
                self._sessions.popitem(last=False)
            cookie = secrets.token_urlsafe(32)
            self._sessions[cookie] = Session(user, used_s=self._clock(), line=line)
        self._tell(f"page: {user} has come in")
        return cookie

    def session(self, cookie: str, *, used: bool = True) -> Session | None:
        """Return the session of a cookie; None where there is none.

        Parameters
        ----------
        cookie : str
            What the browser sent.
        used : bool
            Whether this counts as a use.
        """
        with self._lock:
            found = self._sessions.get(cookie)
            if found is None:
                return None
            now_s = self._clock()
            if now_s - found.used_s > SESSION_S:
                del self._sessions[cookie]
                return None
            if used:
                found.used_s = now_s
                self._sessions.move_to_end(cookie)
            return found

    def still(self, cookie: str) -> Session | None:
        """Return the session of a cookie whose user may still come in; any other ends.

        Raises
        ------
        ConfigError
            If the file of users cannot be read.
        """
        found = self.session(cookie)
        if found is not None and read_users(self._path).get(found.user) != found.line:
            self.leave(cookie)
            return None
        return found

    def leave(self, cookie: str) -> None:
        """End a session."""
        with self._lock:
            self._sessions.pop(cookie, None)
