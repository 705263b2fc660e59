# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Set up valve_twin in this folder: environment, ROS 2, messages, package, compiled kernels.

Needs nothing but a Python 3.10-3.13 of its own. Every step remembers a fingerprint of its inputs
in .venv/valve_twin_setup.json and is skipped while they stay the same. Where ROS 2 is sourced
(ROS_DISTRO is set) that installation is used; elsewhere its Jazzy wheels fill the virtual
environment as one ament prefix, or those of Kilted (VALVE_TWIN_ROS=kilted) another beside it.
"""

import sys

OLDEST, NEWEST = (3, 10), (3, 13)
if not OLDEST <= sys.version_info[:2] <= NEWEST:  # an older Python could not run the rest
    sys.exit(
        "setup: %s is Python %d.%d; valve_twin runs on Python 3.10 to 3.13: name one, for "
        "example make setup PYTHON=python3.12" % ((sys.executable,) + sys.version_info[:2])
    )

import argparse
import fcntl
import os
import time
from concurrent.futures import ThreadPoolExecutor

from setup_steps.console import LOG, ROOT, SUFFIX, SetupError, say
from setup_steps.inputs import fingerprints, read_state, write_state
from setup_steps.prefix import PYTHON, install_packages, make_environment, refuse_what_cannot_work
from setup_steps.system import install_system_packages, missing_system_packages
from setup_steps.workspace import (
    check_imports,
    colcon_build,
    compile_ahead,
    translate_sources,
    write_environment,
)


def set_up(demo: str | None) -> tuple[str, ...]:
    """Bring every step up to date whose inputs changed since it last finished.

    Parameters
    ----------
    demo : str or None
        The valve whose demo is wanted, empty for the usual one: only its kernels are compiled.
        None = everything.

    Returns
    -------
    tuple of str
        What is left to `make setup`.
    """
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
    translate_sources()
    # The packages are built and the kernels compiled side by side.
    with ThreadPoolExecutor() as pool:
        steps = [
            pool.submit(build_packages, state, wanted, distro),
            pool.submit(compile_kernels, state, wanted, distro, demo),
        ]
    for step in steps:
        if step.exception() is None:
            state.update(step.result())
            write_state(state)
    for step in steps:
        step.result()
    return () if state.get("kernels") == wanted["kernels"] else ("the kernels of other valves",)


def build_packages(state: dict[str, str], wanted: dict[str, str], distro: str) -> dict[str, str]:
    """Build messages and package, check that all of it imports; return what is done now."""
    steps = {"messages": "valve_twin_msgs", "package": "valve_twin"}
    built = all((ROOT / f"install{SUFFIX}" / name).is_dir() for name in steps.values())
    stale = [step for step in steps if not built or state.get(step) != wanted[step]]
    if stale:
        colcon_build([steps[step] for step in stale], distro)
        write_environment(distro)
        check_imports(distro)
    return {step: wanted[step] for step in stale}


def compile_kernels(
    state: dict[str, str], wanted: dict[str, str], distro: str, demo: str | None
) -> dict[str, str]:
    """Compile all kernels, or those of a demo, whose sources are not those of their cache."""
    step = "kernels" if demo is None else f"kernels of demo {demo}"
    compiled = {name for name, value in state.items() if value == wanted["kernels"]}
    if compiled & {"kernels", step}:
        return {}
    compile_ahead(distro, demo)
    return {step: wanted["kernels"]}


def main() -> int:
    """Set up, one process at a time; return the exit code."""
    parser = argparse.ArgumentParser(prog="tools/bootstrap.py", description=__doc__)
    parser.add_argument(
        "--demo",
        metavar="VALVE",
        nargs="?",
        const="",
        help="only what the demo of a valve needs; the rest is left to a call without",
    )
    demo = parser.parse_args().demo
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
            left = set_up(demo)
        except SetupError as error:
            print(f"setup: {error}", file=sys.stderr)
            return 1
    say(f"ready ({time.monotonic() - start:.1f} s); tools/run COMMAND runs a command in it")
    if left:
        say(f"left to make setup: {', '.join(left)}; until then each is compiled at its first use")
    return 0


if __name__ == "__main__":
    sys.exit(main())
