# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What each step depends on, as fingerprints, and the record of the finished steps."""

import hashlib
import json
import os
import sys
import sysconfig
from collections.abc import Iterable, Mapping
from pathlib import Path

from setup_steps.console import ROOT, SUFFIX

STATE = ROOT / f".venv{SUFFIX}" / "valve_twin_setup.json"
LOCK = ROOT / "requirements.lock"
ROS_LOCK = ROOT / f"requirements-ros{SUFFIX}.lock"
FORMAT = "3"  # raise it when these scripts make an environment that differs from the one before


def fingerprints(distro: str) -> dict[str, str]:
    """Return the fingerprint of each step's inputs.

    Parameters
    ----------
    distro : str
        Sourced ROS 2 distribution; empty for the wheels.

    Returns
    -------
    dict
        Hexadecimal hash by step, in the order of the steps.
    """
    sourced = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if distro else []
    base = os.pathsep.join(part for part in sourced if not part.startswith(str(ROOT)))
    abi = f"{sysconfig.get_config_var('SOABI')} {sys.base_prefix}"
    words = [FORMAT, str(ROOT), abi, distro, base]
    interpreter = _fingerprint(words)
    ros = [interpreter, "" if distro else ROS_LOCK.read_text(encoding="utf-8")]
    installed = _tree("launch", "config", "layouts", "resource")
    names = [str(path.relative_to(ROOT)) for path in sorted(installed)]
    described = ("setup.py", "setup.cfg", "package.xml", "colcon_defaults.yaml")
    compiled = ("valve_twin/core", "valve_twin/io/cdr", "valve_twin/design/field")
    kernels = [*_tree(*compiled, pattern="*.py"), *ROOT.glob("valve_twin/[kw]*.py")]
    return {
        "interpreter": interpreter,
        "packages": _fingerprint(ros, [LOCK]),
        "messages": _fingerprint(ros, _tree("msg_defs")),
        "package": _fingerprint([interpreter, *names], [ROOT / name for name in described]),
        "kernels": _fingerprint([interpreter], [LOCK, *kernels]),
    }


def read_state() -> dict[str, str]:
    """Return the fingerprints of the finished steps, none where there is no readable record."""
    try:
        state: dict[str, str] = json.loads(STATE.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return state


def write_state(state: Mapping[str, str]) -> None:
    """Record the finished steps."""
    STATE.write_text(json.dumps(state, indent=1) + "\n", encoding="utf-8")


def _tree(*folders: str, pattern: str = "*") -> list[Path]:
    found = (path for folder in folders for path in (ROOT / folder).rglob(pattern))
    return [path for path in found if path.is_file() and "__pycache__" not in path.parts]


def _fingerprint(words: Iterable[str], files: Iterable[Path] = ()) -> str:
    digest = hashlib.sha256()
    for word in words:
        digest.update(word.encode() + b"\0")
    for path in sorted(files):
        digest.update(str(path.relative_to(ROOT)).encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()
