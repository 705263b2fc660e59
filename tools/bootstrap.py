# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Set up valve_twin in this folder: environment, ROS 2, messages, package, compiled kernels.

Needs nothing but a Python 3.10-3.13 of its own. Every step remembers a fingerprint of its inputs
in .venv/valve_twin_setup.json and is skipped while they stay the same. Where ROS 2 is sourced
(ROS_DISTRO is set) that installation is used; elsewhere its Jazzy wheels fill the virtual
environment as one ament prefix.
"""

import sys

OLDEST, NEWEST = (3, 10), (3, 13)
if not OLDEST <= sys.version_info[:2] <= NEWEST:  # an older Python could not run the rest
    sys.exit(
        "setup: %s is Python %d.%d; valve_twin runs on Python 3.10 to 3.13: name one, for "
        "example make setup PYTHON=python3.12" % ((sys.executable,) + sys.version_info[:2])
    )

import fcntl
import os
import time

from setup_steps.console import LOG, ROOT, SetupError, say
from setup_steps.inputs import fingerprints, read_state, write_state
from setup_steps.prefix import PYTHON, install_packages, make_environment, refuse_what_cannot_work
from setup_steps.system import install_system_packages, missing_system_packages
from setup_steps.workspace import check_imports, colcon_build, warm_up, write_environment


def set_up() -> None:
    """Bring every step up to date whose inputs changed since it last finished."""
    distro = os.environ.get("ROS_DISTRO", "")
    wanted = fingerprints(distro)
    state = read_state() if PYTHON.exists() else {}

    if state.get("interpreter") != wanted["interpreter"]:
        refuse_what_cannot_work(distro)
        missing = missing_system_packages()
        if missing:
            install_system_packages(missing)
        make_environment(distro)
        state = {"interpreter": wanted["interpreter"]}
    if state.get("packages") != wanted["packages"]:
        install_packages(distro)
        state["packages"] = wanted["packages"]
        write_state(state)

    steps = {"messages": "valve_twin_msgs", "package": "valve_twin"}
    built = (ROOT / "install" / name for name in steps.values())
    if not all(folder.is_dir() for folder in built):
        state.pop("messages", None)
        state.pop("package", None)
    stale = [step for step in steps if state.get(step) != wanted[step]]
    if stale:
        colcon_build([steps[step] for step in stale], distro)
        write_environment(distro)
        check_imports(distro)
        state.update({step: wanted[step] for step in stale})
        write_state(state)

    if state.get("kernels") != wanted["kernels"]:
        warm_up(distro)
        state["kernels"] = wanted["kernels"]
        write_state(state)


def main() -> int:
    """Set up, one process at a time; return the exit code."""
    os.chdir(ROOT)
    LOG.parent.mkdir(exist_ok=True)
    start = time.monotonic()
    with (LOG.parent / "setup.lock").open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            say("waiting for another set-up in this folder to finish")
            fcntl.flock(lock, fcntl.LOCK_EX)
        try:
            set_up()
        except SetupError as error:
            print(f"setup: {error}", file=sys.stderr)
            return 1
    say(f"ready ({time.monotonic() - start:.1f} s); tools/run COMMAND runs a command in it")
    return 0


if __name__ == "__main__":
    sys.exit(main())
