# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Build the two packages, write the environment that tools/run sources, check it, warm it up."""

import os
import shlex
import subprocess
from collections.abc import Sequence

from setup_steps.console import ROOT, SUFFIX, WHEELS, SetupError, run, say
from setup_steps.prefix import PYTHON, VENV, build_environment, site_packages

ENVIRONMENT = VENV / "valve_twin_env.sh"
SEARCH_PATHS = ("AMENT_PREFIX_PATH", "CMAKE_PREFIX_PATH", "LD_LIBRARY_PATH", "PYTHONPATH", "PATH")
REQUIRED_MODULES = (
    "rclpy",
    "diagnostic_msgs.msg",
    "lifecycle_msgs.msg",
    "rosgraph_msgs.msg",
    "sensor_msgs.msg",
    "std_msgs.msg",
    "std_srvs.srv",
    "valve_twin_msgs.msg",
    "valve_twin_msgs.srv",
    "valve_twin",
    "alembic",
    "cvxpy",
    "daqp",
    "lz4",
    "mcap",
    "numba",
    "numpy",
    "rich",
    "rosbags",
    "scipy",
    "sqlalchemy",
    "yaml",
    "zstandard",
)


def colcon_build(packages: Sequence[str], distro: str) -> None:
    """Build some of the two packages; Python sources are linked, so that later edits are live.

    Parameters
    ----------
    packages : sequence of str
        Their names.
    distro : str
        Sourced ROS 2 distribution; empty for the wheels, whose only nodes are in Python.
    """
    names = " and ".join(packages)
    say(f"building {names} with colcon")
    command = [str(PYTHON), "-m", "colcon", "build", "--symlink-install"]
    command += ["--packages-select", *packages]
    command += ["--build-base", f"build{SUFFIX}", "--install-base", f"install{SUFFIX}"]
    command += ["--cmake-args", "-G", "Ninja", "-DCMAKE_BUILD_TYPE=Release"]
    command += [f"-DPython3_EXECUTABLE={PYTHON}", "-DBUILD_TESTING=OFF", "--no-warn-unused-cli"]
    command += [f"-DWITHOUT_CPP={'OFF' if distro else 'ON'}"]
    run(command, f"colcon build of {names}", build_environment(distro))


def write_environment(distro: str) -> None:
    """Write the shell file that tools/run sources: what colcon's own set-up adds, found once."""
    added = _paths_of_the_workspace()
    added["PATH"].append(str(VENV / "bin"))
    lines = ["# Written by tools/bootstrap.py, sourced by tools/run."]
    if distro:
        remedy = f"tools/run: this environment uses ROS 2 {distro}: source it first"
        lines.append(f'[ -n "${{ROS_DISTRO:-}}" ] || {{ echo "{remedy}" >&2; exit 2; }}')
    else:
        added["AMENT_PREFIX_PATH"].append(str(VENV))
        added["CMAKE_PREFIX_PATH"].append(str(VENV))
        added["LD_LIBRARY_PATH"].append(str(VENV / "lib"))
        added["LD_LIBRARY_PATH"] += map(str, sorted(site_packages(VENV).glob("ros_*.libs")))
        # With the library path set here the wheels need not start the interpreter twice.
        lines += ["unset PYTHONHOME", "export _ROS_WHEELS_BOOTSTRAP_COMPLETE=1"]
        lines += [f"export VALVE_TWIN_ROS={WHEELS}"] if SUFFIX else []
    lines.append(f"export VIRTUAL_ENV={shlex.quote(str(VENV))}")
    for name, parts in added.items():
        value = shlex.quote(os.pathsep.join(parts))
        lines.append(f"export {name}={value}${{{name}:+:${name}}}")
    ENVIRONMENT.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _paths_of_the_workspace() -> dict[str, list[str]]:
    """Return what install/local_setup.sh puts on each search path."""
    script = f"unset {' '.join(SEARCH_PATHS[:-1])}; PATH=/usr/bin:/bin; "
    script += f". install{SUFFIX}/local_setup.sh; "
    script += "printf '%s\\n' " + " ".join(f'"${name}"' for name in SEARCH_PATHS)
    environment = {**os.environ, "COLCON_PYTHON_EXECUTABLE": str(PYTHON)}
    shell = subprocess.run(
        ["/bin/sh", "-c", script],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    if shell.returncode != 0:
        cause = " ".join(shell.stderr.split())
        raise SetupError(f"install{SUFFIX}/local_setup.sh failed: {cause}; call make clean setup")
    found = zip(SEARCH_PATHS, shell.stdout.splitlines(), strict=True)
    return {name: [p for p in line.split(":") if p.startswith(str(ROOT))] for name, line in found}


def check_imports(distro: str) -> None:
    """Import every required package with the interpreter of the installed executables."""
    say("checking that every required package imports")
    command = _inside("python", "-c", f"import {', '.join(REQUIRED_MODULES)}")
    run(command, "the import check", build_environment(distro))


def compile_ahead(distro: str, demo: str | None) -> None:
    """Compile the numerical kernels into their cache, so that no node compiles while it runs.

    Does not wait for the packages to be built: it runs from the sources, whose entry points are
    written beside.

    Parameters
    ----------
    distro : str
        Sourced ROS 2 distribution; empty for the wheels.
    demo : str or None
        The one valve whose demo is wanted, empty for the usual one; None = all kernels.
    """
    if not (ROOT / "valve_twin" / "warmup.py").is_file():
        return
    what = "the numerical kernels" if demo is None else "the numerical kernels of the demo"
    say(f"compiling {what}")
    arguments = [] if demo is None else ["--demo", *filter(None, [demo])]
    environment, names = build_environment(distro), VENV / "entry_points"
    names.mkdir(exist_ok=True)
    paths = [str(ROOT), str(names), *filter(None, [environment.get("PYTHONPATH")])]
    environment["PYTHONPATH"] = os.pathsep.join(paths)
    environment.setdefault("OMP_NUM_THREADS", "1")  # more threads spin and give nothing
    command = [str(PYTHON), "setup.py", "-q", "egg_info", "--egg-base", str(names)]
    run(command, "listing the valves", environment, "setup_kernels.log")
    command = [str(PYTHON), "-m", "valve_twin.warmup", *arguments]
    run(command, f"compiling {what}", environment, "setup_kernels.log")


def translate_sources() -> None:
    """Write the bytecode of the package, which saves a node a quarter of its start.

    A process that may not write beside the sources, as a service of another user, or whose
    environment forbids it (PYTHONDONTWRITEBYTECODE), would translate 300 modules at every start.
    """
    command = [str(PYTHON), "-m", "compileall", "-q", "valve_twin"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise SetupError(
            f"the sources cannot be translated: {(done.stdout + done.stderr).strip()}"
        )


def _inside(*command: str) -> list[str]:
    return [str(ROOT / "tools" / "run"), *command]
