# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Certificates that nobody would take are one line that names the file."""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys
from datetime import datetime, timedelta, timezone

import pytest

pytest.importorskip("asyncua", reason="needs the extra gateway")

from cryptography import x509
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat

from test.small_disk import PAGE_B, small_disk
from valve_twin.gateway.opcua import access
from valve_twin.gateway.opcua.access import Access, check_pair
from valve_twin.io.errors import ConfigError

DAY = timedelta(days=1)


def write_pair(folder, begin_days: int = -9, end_days: int = 9):
    """Write a certificate that holds for these days from today on, and its key."""
    key, name, now = (
        ec.generate_private_key(ec.SECP256R1()),
        x509.Name([]),
        datetime.now(timezone.utc),
    )
    made = x509.CertificateBuilder(name, name, key.public_key(), 7)
    made = made.not_valid_before(now + begin_days * DAY).not_valid_after(now + end_days * DAY)
    (folder / "certificate.der").write_bytes(made.sign(key, SHA256()).public_bytes(Encoding.DER))
    form = Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()
    (folder / "key.pem").write_bytes(key.private_bytes(*form))


def test_a_pair_that_holds_today_is_taken(tmp_path):
    write_pair(tmp_path)
    check_pair(tmp_path)


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda folder: (folder / "certificate.der").unlink(), "certificate.der: No such file"),
        (lambda folder: (folder / "key.pem").unlink(), "key.pem: No such file"),
        (lambda folder: (folder / "certificate.der").write_bytes(b"x"), "no certificate .DER."),
        (lambda folder: (folder / "key.pem").write_bytes(b"x"), "no certificate .DER. with its"),
        (lambda folder: write_pair(folder, -9, -2), "holds from .* put a new one there"),
        (lambda folder: write_pair(folder, 2, 9), "holds from .* put a new one there"),
    ],
)
def test_a_pair_that_nobody_would_take_is_one_line(tmp_path, spoil, said):
    write_pair(tmp_path)
    spoil(tmp_path)
    with pytest.raises(ConfigError, match=said) as caught:
        check_pair(tmp_path)
    assert "\n" not in str(caught.value)


def test_a_key_of_another_certificate_is_refused(tmp_path):
    write_pair(tmp_path)
    key = (tmp_path / "key.pem").read_bytes()
    write_pair(tmp_path)
    (tmp_path / "key.pem").write_bytes(key)
    with pytest.raises(ConfigError, match=r"certificate.der: does not belong to .*key.pem"):
        check_pair(tmp_path)


def test_a_disk_that_takes_only_one_of_a_new_pair_keeps_none_and_is_told_what_it_is(tmp_path):
    """The key stayed without its certificate, and had to be removed by hand for the next start."""
    with small_disk(tmp_path / "disk", "1m") as disk:
        disk.fill(PAGE_B)
        with pytest.raises(ConfigError, match="pki: cannot be written: No space left") as caught:
            asyncio.run(Access(disk.place / "pki", anonymous=True).prepare())
        assert isinstance(caught.value.__cause__, OSError)  # by which a node tries again
        assert list((disk.place / "pki").iterdir()) == []
        disk.empty()
        asyncio.run(Access(disk.place / "pki", anonymous=True).prepare())
        made = sorted((disk.place / "pki").iterdir())
        assert [path.name for path in made] == ["certificate.der", "key.pem"]
        assert made[1].stat().st_mode & 0o77 == 0


def test_a_folder_that_another_program_keeps_locked_is_told(tmp_path, monkeypatch):
    """A server waited for good, and its start took it for begun."""
    fcntl = pytest.importorskip("fcntl")
    monkeypatch.setattr(access, "TURN_S", 0.2)
    held = os.open(tmp_path, os.O_RDONLY)
    try:
        fcntl.flock(held, fcntl.LOCK_EX)
        with pytest.raises(ConfigError, match="another program has locked it for"):
            asyncio.run(Access(tmp_path, anonymous=True).prepare())
    finally:
        os.close(held)
    asyncio.run(Access(tmp_path, anonymous=True).prepare())
    assert (tmp_path / "key.pem").exists()


MAKE = """
import asyncio, sys
from pathlib import Path
from valve_twin.gateway.opcua.access import Access

print("ready", flush=True)
sys.stdin.readline()
for n in range(10):
    asyncio.run(Access(Path(sys.argv[1]) / str(n), anonymous=True).prepare())
"""


def test_servers_that_start_at_once_take_one_pair(tmp_path):
    """Key and certificate of two of them lay side by side, and no server started any more."""
    command = [sys.executable, "-c", MAKE, str(tmp_path)]
    pipe = subprocess.PIPE
    servers = [
        subprocess.Popen(command, text=True, stdin=pipe, stdout=pipe, stderr=pipe)
        for _ in range(3)
    ]
    for server in servers:
        assert server.stdout is not None
        assert server.stdout.readline() == "ready\n"
    for server in servers:
        assert server.stdin is not None
        server.stdin.write("\n")
        server.stdin.flush()
    said = [server.communicate(timeout=120)[1] for server in servers]
    assert said == ["", "", ""]
    for n in range(10):
        check_pair(tmp_path / str(n))
