# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Who may look: users, certificates, encryption; and that nobody may do more than look."""

from __future__ import annotations

import asyncio
import os
import socket
import time
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass
from datetime import datetime, timezone
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from asyncua import ua
from asyncua.common.utils import ServiceError
from asyncua.crypto.cert_gen import setup_self_signed_certificate
from asyncua.crypto.permission_rules import USER_TYPES, PermissionRuleset, User, UserRole
from asyncua.crypto.security_policies import SecurityPolicyFactory, SecurityPolicyNone
from asyncua.server.internal_session import SessionState
from cryptography import x509
from cryptography.hazmat.primitives.serialization import Encoding, load_pem_private_key
from cryptography.x509.oid import ExtendedKeyUsageOID

from valve_twin.compat.opcua import policies_of, sessions_of
from valve_twin.io.errors import ConfigError, unwritable

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from asyncua import Server

    from valve_twin.gateway.passwords import Passwords

APPLICATION = f"urn:{socket.gethostname()}:valve_twin:gateway"
"""Name of the server among all; its certificate carries it."""

MOST_SESSIONS = 200
"""Sessions at a time [1]."""

CERTIFICATE, KEY = "certificate.der", "key.pem"
"""Files of the server's own pair."""

TURN_S = 30.0
"""To make a pair takes a second or two; who waits longer for another one to have made it is told
[s]."""

_LOOK_S = 0.05
_POLICY = ua.SecurityPolicyType
_REFUSED = {
    ua.ObjectIds.WriteRequest_Encoding_DefaultBinary,
    ua.ObjectIds.CallRequest_Encoding_DefaultBinary,
}
_LOOKING = {ua.NodeId(kind) for kind in USER_TYPES if kind not in _REFUSED}


class _LookOnly(PermissionRuleset):  # type: ignore[misc]
    """Lets who has logged in browse, read and subscribe, and do nothing else."""

    def check_validity(self, user: User, action_type: ua.NodeId, _: object) -> bool:
        return user.role is UserRole.User and action_type in _LOOKING


class _Nothing(PermissionRuleset):  # type: ignore[misc]
    """For a channel that is not encrypted: who may come in and how can be asked, no more."""

    def check_validity(self, *_: object) -> bool:
        return False


@dataclass(frozen=True, slots=True)
class Access:
    """Who may look.

    Attributes
    ----------
    folder : Path
        Holds certificate.der and key.pem of the server, made where both are missing, and in
        trusted/ certificates (DER) of clients; is there one, no other client is let in.
    passwords : Passwords or None
        Users by password.
    anonymous : bool
        Whether anybody may look, also without encryption.
    """

    folder: Path
    passwords: Passwords | None = None
    anonymous: bool = False

    async def prepare(self) -> dict[bytes, str]:
        """Return whose certificates are trusted; make the server's own where there is none.

        Raises
        ------
        ConfigError
            If nobody could come in, or certificate or key cannot be used.
        """
        trusted = await asyncio.to_thread(read_trusted, self.folder / "trusted")
        if not (self.anonymous or self.passwords or trusted):
            msg = (
                "OPC UA: nobody could come in: name --opcua-users, put certificates into "
                f"{self.folder / 'trusted'}, or let anybody look by --anonymous"
            )
            raise ConfigError(msg)
        await _provide_own(self.folder)
        return trusted

    async def apply(self, server: Server, trusted: dict[bytes, str]) -> None:
        """Set a server up that has not started.

        Parameters
        ----------
        server : Server
            It.
        trusted : dict of bytes to str
            As `prepare` returned it.
        """
        await server.load_certificate(self.folder / CERTIFICATE)
        await server.load_private_key(self.folder / KEY)
        rules = _LookOnly()
        policies = [_POLICY.Basic256Sha256_SignAndEncrypt, _POLICY.Basic256Sha256_Sign]
        tokens = [ua.X509IdentityToken]
        if self.passwords:
            tokens.append(ua.UserNameIdentityToken)
        if self.anonymous:
            tokens.append(ua.AnonymousIdentityToken)
            policies.append(_POLICY.NoSecurity)
        else:  # asyncua opens such a channel anyway and would then ask nobody for permission
            none = ua.MessageSecurityMode.None_
            policies_of(server).append(
                SecurityPolicyFactory(SecurityPolicyNone, none, permission_ruleset=_Nothing())
            )
        server.set_security_policy(policies, permission_ruleset=rules)
        server.set_identity_tokens(tokens)
        _close_ways_in(server)
        server.iserver.certificate_validator = _Validator(trusted)
        server.iserver.user_manager = _Users(self, trusted)


def _close_ways_in(server: Server) -> None:
    """Take from asyncua what it does for whoever has not logged in.

    It hands a session to another channel before it asks who that is, takes entries for its list of
    servers, and keeps every session that is made and never used: where there are too many, the
    oldest of these makes way, else whoever guesses would keep everybody else out.
    """
    inner = server.iserver
    make = inner.create_session

    def refuse(*_: object) -> None:
        raise ServiceError(ua.StatusCodes.BadServiceUnsupported)

    def create(name: str, *arguments: Any, **named: Any) -> Any:  # noqa: ANN401  of asyncua
        found = sessions_of(server)
        if len(found) >= MOST_SESSIONS:
            unused = (s for s in found.values() if s.state is SessionState.Created)
            oldest = next(unused, None)
            if oldest is None:
                raise ServiceError(ua.StatusCodes.BadTooManySessions)
            oldest.state = SessionState.Closed
            inner.unregister_external_session(oldest)
        session = make(name, *arguments, **named)
        session.activate_session = partial(_activate, session.activate_session, name)
        return session

    inner.lookup_external_session = lambda _: None
    inner.register_server, inner.create_session = refuse, create


_PLACE: ContextVar[str] = ContextVar("place", default="")
"""Address of the client whose session is being activated: asyncua does not tell who asks."""


def _activate(activate: Callable[..., Any], name: object, *arguments: Any) -> Any:  # noqa: ANN401
    """Activate a session; it is named by asyncua after the address of its client."""
    token = _PLACE.set(str(name[0]) if isinstance(name, tuple) and name else "")
    try:
        return activate(*arguments)
    finally:
        _PLACE.reset(token)


class _Users:
    """Tells asyncua who somebody is; None = nobody who may come in."""

    def __init__(self, access: Access, trusted: Mapping[bytes, str]) -> None:
        self._access, self._trusted = access, trusted

    def get_user(
        self,
        _: object,
        username: str | None = None,
        password: str | None = None,
        certificate: bytes | None = None,
    ) -> User | None:
        if username is not None:
            if self._trusted and not self._access.anonymous and certificate not in self._trusted:
                return None
            passwords = self._access.passwords
            if passwords and passwords.fits(username, password or "", _PLACE.get()):
                return User(UserRole.User, username)
            return None
        if certificate is not None and certificate in self._trusted:
            return User(UserRole.User, self._trusted[certificate])
        return User(UserRole.User, "anonymous") if self._access.anonymous else None


class _Validator:
    """Refuses a client with a certificate out of date, or not a trusted one if there are any."""

    def __init__(self, trusted: Mapping[bytes, str]) -> None:
        self._trusted = trusted

    async def __call__(self, certificate: x509.Certificate, _: object) -> None:
        if not is_in_date(certificate):
            raise ServiceError(ua.StatusCodes.BadCertificateTimeInvalid)
        if self._trusted and certificate.public_bytes(Encoding.DER) not in self._trusted:
            raise ServiceError(ua.StatusCodes.BadCertificateUntrusted)


def is_in_date(certificate: x509.Certificate) -> bool:
    """Return whether a certificate holds today."""
    now = datetime.now(timezone.utc)
    return bool(certificate.not_valid_before_utc <= now <= certificate.not_valid_after_utc)


def read_trusted(folder: Path) -> dict[bytes, str]:
    """Return the certificates of a folder with their files' names; none where it is missing.

    Raises
    ------
    ConfigError
        If a file is no certificate (DER).
    """
    found = {}
    for path in sorted(folder.glob("*.der")):
        try:
            data = path.read_bytes()
            x509.load_der_x509_certificate(data)
        except (OSError, ValueError) as err:
            msg = f"{path}: is no certificate (DER): {err}"
            raise ConfigError(msg) from err
        found[data] = path.stem
    return found


async def _provide_own(folder: Path) -> None:
    certificate, key = pair = folder / CERTIFICATE, folder / KEY
    try:
        if not all(path.exists() for path in pair):
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            with _turn(folder):
                if not any(path.exists() for path in pair):
                    await _make_own(certificate, key)
    except OSError as err:
        raise ConfigError(unwritable(folder, err)) from err
    for path, other in (pair, pair[::-1]):
        if other.exists() and not path.exists():
            msg = f"{path}: is missing: put it beside the other, or remove both for new ones"
            raise ConfigError(msg)
    check_pair(folder)


def check_pair(folder: Path) -> None:
    """Refuse a certificate.der that does not hold today, or a key.pem that does not fit it.

    Raises
    ------
    ConfigError
        One line that names the file.
    """
    certificate, key = folder / CERTIFICATE, folder / KEY
    try:
        own = x509.load_der_x509_certificate(certificate.read_bytes())
        fits = own.public_key() == load_pem_private_key(key.read_bytes(), None).public_key()
    except OSError as err:
        msg = f"{err.filename or folder}: {err.strerror or err}: put it there, readable"
        raise ConfigError(msg) from err
    except (ValueError, TypeError) as err:
        msg = f"{certificate}, {key}: no certificate (DER) with its key (PEM): {_line(err)}"
        raise ConfigError(msg) from err
    if not is_in_date(own):
        msg = (
            f"{certificate}: holds from {own.not_valid_before_utc:%Y-%m-%d} to "
            f"{own.not_valid_after_utc:%Y-%m-%d}: put a new one there, or remove it and its key"
        )
        raise ConfigError(msg)
    if not fits:
        msg = f"{certificate}: does not belong to {key}: put the right pair there"
        raise ConfigError(msg)


@contextmanager
def _turn(folder: Path) -> Iterator[None]:
    """Wait until nobody else makes a pair here: of servers that start at once one does."""
    try:
        import fcntl
    except ImportError:
        yield
        return
    held = os.open(folder, os.O_RDONLY)
    end_s = time.monotonic() + TURN_S
    try:
        with suppress(OSError):  # a file system without locks
            while True:
                try:
                    fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
                except BlockingIOError:
                    if time.monotonic() >= end_s:
                        msg = f"{folder}: another program has locked it for {TURN_S:.0f} s: end it"
                        raise ConfigError(msg) from None
                    time.sleep(_LOOK_S)
                else:
                    break
        yield
    finally:
        os.close(held)


async def _make_own(certificate: Path, key: Path) -> None:
    """Make both beside their places: a disk that takes only one of them leaves none."""
    with TemporaryDirectory(prefix=".", dir=key.parent) as beside:
        made = Path(beside) / key.name, Path(beside) / certificate.name
        await setup_self_signed_certificate(
            *made,
            APPLICATION,
            socket.gethostname(),
            [ExtendedKeyUsageOID.SERVER_AUTH],
            {"organizationName": "valve_twin"},
        )
        await asyncio.to_thread(_put, made, (key, certificate))


def _put(made: tuple[Path, Path], places: tuple[Path, Path]) -> None:
    made[0].chmod(0o600)
    for part in made:
        with part.open("rb+") as file:
            os.fsync(file.fileno())
    try:
        for part, place in zip(made, places, strict=True):
            part.replace(place)
    except OSError:
        for place in places:
            place.unlink(missing_ok=True)
        raise


def _line(err: Exception) -> str:
    return (str(err).strip().splitlines() or [type(err).__name__])[0]
