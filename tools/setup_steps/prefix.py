# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The virtual environment: Python packages and, where no ROS 2 is sourced, ROS 2 itself."""

import os
import platform
import re
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

from setup_steps.console import DISTROS, ROOT, SUFFIX, WHEELS, SetupError, run, say
from setup_steps.inputs import LOCK, ROS_LOCK

VENV = ROOT / f".venv{SUFFIX}"
PYTHON = VENV / "bin" / "python"
BUILDER_PATH = re.compile(
    r"/opt/python/cp3\d+-cp3\d+t?/(?:(include)/python3\.\d+|lib/python3\.\d+/site-packages)"
)


def refuse_what_cannot_work(distro: str) -> None:
    """Raise SetupError before anything is downloaded that could not be used."""
    if WHEELS not in DISTROS:
        raise SetupError(f"ROS={WHEELS}: there are wheels of {' and '.join(DISTROS)}")
    if distro and SUFFIX and distro != WHEELS:
        raise SetupError(
            f"ROS 2 {distro} is sourced, ROS={WHEELS} was asked for: open a shell without ROS 2"
        )
    if distro:
        probe = [sys.executable, "-c", "import rclpy"]
        if subprocess.run(probe, capture_output=True, check=False).returncode != 0:
            raise SetupError(
                f"ROS 2 {distro} is sourced, but {sys.executable} cannot import rclpy: name the "
                "Python it was built for, for example make setup PYTHON=/usr/bin/python3, or "
                "open a shell without ROS 2"
            )
    elif (platform.system(), platform.machine()) != ("Linux", "x86_64"):
        raise SetupError(
            f"the ROS 2 wheels are for Linux on x86_64, this is {platform.system()} on "
            f"{platform.machine()}: source an installed ROS 2 first (. /opt/ros/jazzy/setup.sh)"
        )


def build_environment(distro: str) -> dict[str, str]:
    """Return the process environment in which pip, colcon and the checks run."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONHOME"}
    environment["VIRTUAL_ENV"] = str(VENV)
    environment["PATH"] = f"{VENV / 'bin'}{os.pathsep}{environment.get('PATH', os.defpath)}"
    environment["PYTHONWARNINGS"] = "ignore"
    if not distro:
        environment["AMENT_PREFIX_PATH"] = environment["CMAKE_PREFIX_PATH"] = str(VENV)
        environment.pop("PYTHONPATH", None)
        environment.pop("_ROS_WHEELS_BOOTSTRAP_COMPLETE", None)
    return environment


def make_environment(distro: str) -> None:
    """Make an empty virtual environment; what an earlier one had built goes with it."""
    built = ("build{}/valve_twin", "build{}/valve_twin_msgs", "install{}")
    for folder in (name.format(SUFFIX) for name in built):
        shutil.rmtree(ROOT / folder, ignore_errors=True)
    source = f"ROS 2 {distro} as sourced" if distro else f"the ROS 2 {WHEELS.title()} wheels"
    say(f"making {VENV.name} with Python {platform.python_version()} and {source}")
    options = ["--clear"] + (["--system-site-packages"] if distro else [])
    command = [sys.executable, "-m", "venv", *options, str(VENV)]
    run(command, "making the virtual environment", build_environment(distro))


def install_packages(distro: str) -> None:
    """Install what the lock files pin."""
    locks = [LOCK] if distro else [LOCK, ROS_LOCK]
    say(f"installing what {' and '.join(lock.name for lock in locks)} pin (1.2 GB, some minutes)")
    command = [str(PYTHON), "-m", "pip", "install", "--no-deps", "--no-input"]
    command += ["--disable-pip-version-check", "--progress-bar", "off"]
    for lock in locks:
        command += ["-r", str(lock)]
    run(command, "pip install", build_environment(distro))
    if not distro:
        say(f"  {patch_wheels(VENV)} CMake files of the wheels now name this Python")


def site_packages(prefix: Path) -> Path:
    """Return where a virtual environment keeps its packages, also for the Python of Debian.

    That one's own scheme, `posix_local`, has `local/lib/python3.x/dist-packages` instead.
    """
    return Path(sysconfig.get_path("purelib", "posix_prefix", {"base": str(prefix)}))


def patch_wheels(prefix: Path) -> int:
    """Point the wheels' CMake files at this environment instead of the machine that built them.

    Parameters
    ----------
    prefix : Path
        Virtual environment that holds the ROS 2 wheels.

    Returns
    -------
    int
        Number of files changed.
    """
    here = {"include": sysconfig.get_path("include"), None: str(site_packages(prefix))}
    changed = 0
    for path in (prefix / "share").rglob("*.cmake"):
        text = path.read_text(encoding="utf-8")
        new = BUILDER_PATH.sub(lambda match: here[match.group(1)], text)
        if new != text:
            path.write_text(new, encoding="utf-8")
            changed += 1
    return changed
