# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""System packages that no Python package can bring: compiler, headers, venv."""

import importlib.util
import os
import shlex
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Sequence
from pathlib import Path

from setup_steps.console import SetupError, run, say


def missing_system_packages() -> list[str]:
    """Return the Debian packages that have to be installed before the rest can run."""
    version = f"python{sys.version_info[0]}.{sys.version_info[1]}"
    compilers = (os.environ.get("CXX", ""), "c++", "g++", "clang++")
    missing = []
    if not all(importlib.util.find_spec(name) for name in ("venv", "ensurepip")):
        missing.append(f"{version}-venv")
    if not Path(sysconfig.get_path("include"), "Python.h").is_file():
        missing.append(f"{version}-dev")
    if not any(shutil.which(name) for name in compilers if name):
        missing.append("g++")
    return missing


def install_system_packages(packages: Sequence[str]) -> None:
    """Install system packages where that is allowed.

    Parameters
    ----------
    packages : sequence of str
        Names of Debian packages.

    Raises
    ------
    SetupError
        They cannot be installed from here; the text names the command that does it.
    """
    missing = f"missing on this machine: {', '.join(packages)}"
    advice = "sudo " + shlex.join(["apt-get", "install", *packages])
    if shutil.which("apt-get") is None:
        raise SetupError(f"{missing} (names in Debian); install them and call again")
    allowed = _as_root()
    if allowed is None:
        raise SetupError(f"{missing}; install them and call again: {advice}")
    say(f"{missing}; installing with apt-get")
    quiet = {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}
    command = ["apt-get", "install", "-y", "--no-install-recommends", *packages]
    try:
        run([*allowed, "apt-get", "update"], "apt-get update", quiet)
        run([*allowed, *command], "apt-get install", quiet)
    except SetupError as error:
        raise SetupError(f"{missing}; {error}; install them and call again: {advice}") from None


def _as_root() -> list[str] | None:
    """Return the prefix that runs a command as root; None where that needs a person."""
    if os.geteuid() == 0:
        return []
    if shutil.which("sudo") is None:
        return None
    asked = subprocess.run(["sudo", "-n", "true"], capture_output=True, check=False)
    return ["sudo", "-n"] if asked.returncode == 0 else None
