# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Set up valve_twin in this folder: virtual environment, ROS 2, interface package, package, compiled kernels.

Needs nothing but a Python 3.10-3.13 of its own. Every step remembers a fingerprint of its inputs in
.venv/valve_twin_setup.json and is skipped while they stay the same. Where ROS 2 is sourced (ROS_DISTRO is set) that
installation is used; elsewhere its Jazzy wheels fill the virtual environment as one ament prefix.
"""

import sys

OLDEST, NEWEST = (3, 10), (3, 13)
if not OLDEST <= sys.version_info[:2] <= NEWEST:  # before anything that an older Python could not run
    sys.exit(
        "setup: %s is Python %d.%d; valve_twin runs on Python 3.10 to 3.13: name one, for example "
        "make setup PYTHON=python3.12" % ((sys.executable,) + sys.version_info[:2])
    )

import fcntl  # noqa: E402
import hashlib  # noqa: E402
import importlib.util  # noqa: E402
import json  # noqa: E402
import os  # noqa: E402
import platform  # noqa: E402
import re  # noqa: E402
import shlex  # noqa: E402
import shutil  # noqa: E402
import subprocess  # noqa: E402
import sysconfig  # noqa: E402
import time  # noqa: E402
from collections.abc import Iterable, Mapping, Sequence  # noqa: E402
from pathlib import Path  # noqa: E402

ROOT = Path(__file__).resolve().parent.parent
VENV = ROOT / ".venv"
PYTHON = VENV / "bin" / "python"
STATE = VENV / "valve_twin_setup.json"
ENVIRONMENT = VENV / "valve_twin_env.sh"
LOG = ROOT / "log" / "setup.log"
LOCKS = ("requirements.lock", "requirements-ros.lock")
PACKAGES = ("valve_twin_msgs", "valve_twin")
FORMAT = "1"  # raise it when this script makes an environment that differs from the one before
HEARTBEAT_S = 15.0
SEARCH_PATHS = ("AMENT_PREFIX_PATH", "CMAKE_PREFIX_PATH", "LD_LIBRARY_PATH", "PATH", "PYTHONPATH")
REQUIRED = (
    "rclpy",
    "diagnostic_msgs.msg",
    "lifecycle_msgs.msg",
    "sensor_msgs.msg",
    "valve_twin_msgs.msg",
    "valve_twin",
    "alembic",
    "cvxpy",
    "daqp",
    "mcap",
    "numba",
    "rich",
    "rosbags",
    "scipy",
    "sqlalchemy",
    "yaml",
)


class SetupError(Exception):
    """One line for the user: what is wrong and what to do."""


def say(text: str) -> None:
    """Tell the user what is being done."""
    print(f"setup: {text}", flush=True)


def fingerprint(parts: Iterable[str], files: Iterable[Path] = ()) -> str:
    """Return a hash of some words and of the names and contents of some files."""
    digest = hashlib.sha256()
    for part in parts:
        digest.update(part.encode() + b"\0")
    for path in sorted(files):
        digest.update(str(path.relative_to(ROOT)).encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()


def run(command: Sequence[str], what: str, environment: Mapping[str, str]) -> None:
    """Run a command into the log, with a sign of life now and then; raise with the end of its output."""
    LOG.parent.mkdir(exist_ok=True)
    start = time.monotonic()
    with LOG.open("ab") as log:
        log.write(f"\n$ {shlex.join(command)}\n".encode())
        log.flush()
        begin = log.tell()
        process = subprocess.Popen(
            command, cwd=ROOT, env=dict(environment), stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT
        )
        while True:
            try:
                code = process.wait(timeout=HEARTBEAT_S)
                break
            except subprocess.TimeoutExpired:
                say(f"  ... {what}, {time.monotonic() - start:.0f} s so far")
    if code != 0:
        output = LOG.read_bytes()[begin:].decode(errors="replace")
        lines = [line for line in output.splitlines() if "is neither a file nor a directory" not in line]
        print("\n".join(lines[-40:]), file=sys.stderr)
        raise SetupError(f"{what} failed (exit code {code}); the whole output is in {LOG.relative_to(ROOT)}")
    say(f"  done in {time.monotonic() - start:.0f} s")


# --- system packages ---------------------------------------------------------------------------------------------


def missing_system_packages() -> list[str]:
    """Return the Debian packages that have to be installed before the rest can run."""
    version = f"python{sys.version_info[0]}.{sys.version_info[1]}"
    missing = []
    if importlib.util.find_spec("ensurepip") is None or importlib.util.find_spec("venv") is None:
        missing.append(f"{version}-venv")
    if not Path(sysconfig.get_path("include"), "Python.h").is_file():
        missing.append(f"{version}-dev")
    if not any(shutil.which(name) for name in (os.environ.get("CXX", ""), "c++", "g++", "clang++") if name):
        missing.append("g++")
    return missing


def install_system_packages(packages: Sequence[str]) -> None:
    """Install system packages where that is allowed, else say how."""
    command = ["apt-get", "install", "-y", "--no-install-recommends", *packages]
    advice = "sudo " + shlex.join(["apt-get", "install", *packages])
    names = ", ".join(packages)
    if shutil.which("apt-get") is None:
        raise SetupError(f"missing on this machine: {names} (Debian names); install them and call again")
    if os.geteuid() == 0:
        prefix = []
    elif shutil.which("sudo") and subprocess.run(["sudo", "-n", "true"], capture_output=True, check=False).returncode == 0:
        prefix = ["sudo", "-n"]
    else:
        raise SetupError(f"missing on this machine: {names}; install them and call again: {advice}")
    say(f"installing system packages: {names}")
    environment = {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}
    try:
        run([*prefix, "apt-get", "update"], "apt-get update", environment)
        run([*prefix, *command], "apt-get install", environment)
    except SetupError as error:
        raise SetupError(f"missing on this machine: {names}; {error}; by hand: {advice}") from None


# --- virtual environment -----------------------------------------------------------------------------------------


def sourced_ros() -> str:
    """Return the name of the sourced ROS 2 distribution, empty where there is none."""
    return os.environ.get("ROS_DISTRO", "")


def check_platform(distro: str) -> None:
    """Refuse what cannot work before anything is downloaded."""
    if distro:
        probe = subprocess.run([sys.executable, "-c", "import rclpy"], capture_output=True, text=True, check=False)
        if probe.returncode != 0:
            raise SetupError(
                f"ROS 2 {distro} is sourced, but {sys.executable} cannot import rclpy: name the Python it was built "
                "for, for example make setup PYTHON=/usr/bin/python3, or open a shell without ROS 2"
            )
    elif (platform.system(), platform.machine()) != ("Linux", "x86_64"):
        raise SetupError(
            f"ROS 2 wheels exist for Linux on x86_64 only, this is {platform.system()} on {platform.machine()}: "
            "source an installed ROS 2 first, for example . /opt/ros/jazzy/setup.sh"
        )


def build_environment(distro: str) -> dict[str, str]:
    """Return the process environment in which pip, colcon and the checks run."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONHOME"}
    environment["VIRTUAL_ENV"] = str(VENV)
    environment["PATH"] = f"{VENV / 'bin'}{os.pathsep}{environment.get('PATH', os.defpath)}"
    environment["PYTHONWARNINGS"] = "ignore"
    if not distro:
        environment.update(dict.fromkeys(("AMENT_PREFIX_PATH", "CMAKE_PREFIX_PATH"), str(VENV)))
        environment.pop("PYTHONPATH", None)
        environment.pop("_ROS_WHEELS_BOOTSTRAP_COMPLETE", None)
    return environment


def make_environment(distro: str) -> None:
    """Make the virtual environment and fill it with the pinned packages."""
    for folder in ("build/valve_twin", "build/valve_twin_msgs", "install"):
        shutil.rmtree(ROOT / folder, ignore_errors=True)
    where = f"ROS 2 {distro} as sourced" if distro else "the ROS 2 Jazzy wheels"
    say(f"making .venv with Python {platform.python_version()} and {where} (1.2 GB, some minutes)")
    site = ["--system-site-packages"] if distro else []
    clean = build_environment(distro)
    run([sys.executable, "-m", "venv", "--clear", *site, str(VENV)], "making the virtual environment", clean)
    locks = LOCKS[:1] if distro else LOCKS
    say(f"installing the packages of {' and '.join(locks)}")
    files = [word for lock in locks for word in ("-r", lock)]
    pip = [str(PYTHON), "-m", "pip", "install", "--no-deps", "--no-input", "--disable-pip-version-check"]
    run([*pip, "--progress-bar", "off", *files], "pip install", clean)
    if not distro:
        patched = patch_wheels(VENV)
        say(f"  {patched} CMake files of the wheels now name this Python")


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
    site_packages = sysconfig.get_path("purelib", vars={"base": str(prefix)})
    builder = re.compile(r"/opt/python/cp3\d+-cp3\d+t?/(?:(include)/python3\.\d+|lib/python3\.\d+/site-packages)")
    here = {"include": sysconfig.get_path("include"), None: site_packages}
    changed = 0
    for path in (prefix / "share").rglob("*.cmake"):
        text = path.read_text(encoding="utf-8")
        new = builder.sub(lambda match: here[match.group(1)], text)
        if new != text:
            path.write_text(new, encoding="utf-8")
            changed += 1
    return changed


# --- build -------------------------------------------------------------------------------------------------------


def colcon_build(packages: Sequence[str], distro: str) -> None:
    """Build some of the two packages; Python sources are linked, so that later edits are live."""
    names = " and ".join(packages)
    say(f"building {names} with colcon" + (" (one to two minutes)" if "valve_twin_msgs" in packages else ""))
    command = [str(PYTHON), "-m", "colcon", "build", "--symlink-install", "--packages-select", *packages]
    command += ["--cmake-args", "-G", "Ninja", "-DCMAKE_BUILD_TYPE=Release", f"-DPython3_EXECUTABLE={PYTHON}"]
    command += ["-DBUILD_TESTING=OFF", "--no-warn-unused-cli"]
    run(command, f"colcon build of {names}", build_environment(distro))


def write_environment(distro: str) -> None:
    """Write the shell file that tools/run sources: what colcon's set-up script adds, found once."""
    names = " ".join(f'"${name}"' for name in SEARCH_PATHS)
    script = f"unset {' '.join(SEARCH_PATHS[:3])} PYTHONPATH; PATH=/usr/bin:/bin; . install/local_setup.sh; "
    script += f"printf '%s\\n' {names}"
    shell = subprocess.run(["/bin/sh", "-c", script], cwd=ROOT, capture_output=True, text=True, check=False)
    if shell.returncode != 0:
        raise SetupError(f"install/local_setup.sh failed: {shell.stderr.strip()}; call make clean setup")
    found = dict(zip(SEARCH_PATHS, shell.stdout.splitlines(), strict=True))
    added = {name: [part for part in found[name].split(os.pathsep) if part.startswith(str(ROOT))] for name in SEARCH_PATHS}
    added["PATH"] += [str(VENV / "bin")]
    lines = ["# Written by tools/bootstrap.py, sourced by tools/run.", f"export VIRTUAL_ENV={shlex.quote(str(VENV))}"]
    if distro:
        lines.append(
            f'[ -n "${{ROS_DISTRO:-}}" ] || {{ echo "tools/run: this environment uses ROS 2 {distro}: source it first" '
            ">&2; exit 2; }"
        )
    else:
        for name in ("AMENT_PREFIX_PATH", "CMAKE_PREFIX_PATH"):
            added[name].append(str(VENV))
        purelib = Path(sysconfig.get_path("purelib", vars={"base": str(VENV)}))
        added["LD_LIBRARY_PATH"] += [str(VENV / "lib"), *map(str, sorted(purelib.glob("ros_*.libs")))]
        lines += ["unset PYTHONHOME", "export _ROS_WHEELS_BOOTSTRAP_COMPLETE=1"]
    for name, parts in added.items():
        value = shlex.quote(os.pathsep.join(parts))
        lines.append(f"export {name}={value}${{{name}:+:${name}}}")
    ENVIRONMENT.write_text("\n".join(lines) + "\n", encoding="utf-8")


def inside(command: Sequence[str]) -> list[str]:
    """Return the command that runs another one inside the environment."""
    return [str(ROOT / "tools" / "run"), *command]


def check_imports(distro: str) -> None:
    """Import every required package with the interpreter of the installed executables."""
    say("checking that every required package imports")
    run(inside(["python", "-c", f"import {', '.join(REQUIRED)}"]), "the import check", build_environment(distro))


def warm_up(distro: str) -> None:
    """Compile the numerical kernels into their cache, so that no node compiles while it runs."""
    for cached in (ROOT / "valve_twin").rglob("__pycache__/*.nb[ci]"):
        cached.unlink(missing_ok=True)  # numba looks at a kernel's own file only, not at the kernels it calls
    if not (ROOT / "valve_twin" / "warmup.py").is_file():
        return
    say("compiling the numerical kernels")
    run(inside(["python", "-m", "valve_twin.warmup"]), "compiling the kernels", build_environment(distro))


# --- all together ------------------------------------------------------------------------------------------------


def tree(*folders: str, pattern: str = "*") -> list[Path]:
    """Return the files below some folders, caches left out."""
    found = (path for folder in folders for path in (ROOT / folder).rglob(pattern))
    return [path for path in found if path.is_file() and "__pycache__" not in path.parts]


def fingerprints(distro: str) -> dict[str, str]:
    """Return the fingerprint of each step's inputs, in the order of the steps."""
    base = os.environ.get("AMENT_PREFIX_PATH", "") if distro else ""
    words = [FORMAT, str(ROOT), sys.version, sys.base_prefix, distro, base]
    environment = fingerprint(words, [ROOT / name for name in LOCKS])
    installed = [str(path.relative_to(ROOT)) for path in sorted(tree("launch", "config", "layouts", "resource"))]
    described = [ROOT / name for name in ("setup.py", "setup.cfg", "package.xml", "colcon_defaults.yaml", "tools/valve-twin")]
    kernels = [*tree("valve_twin/core", pattern="*.py"), *(ROOT / "valve_twin").glob("warmup.py")]
    return {
        "environment": environment,
        "messages": fingerprint([environment], tree("msg_defs")),
        "package": fingerprint([environment, *installed], described),
        "kernels": fingerprint([environment], kernels),
    }


def read_state() -> dict[str, str]:
    """Return the fingerprints of the last finished steps."""
    try:
        state: dict[str, str] = json.loads(STATE.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return state


def write_state(state: Mapping[str, str]) -> None:
    """Remember the finished steps."""
    STATE.write_text(json.dumps(state, indent=1) + "\n", encoding="utf-8")


def set_up() -> None:
    """Bring everything up to date."""
    distro = sourced_ros()
    wanted = fingerprints(distro)
    state = read_state()
    if not PYTHON.exists() or state.get("environment") != wanted["environment"]:
        check_platform(distro)
        missing = missing_system_packages()
        if missing:
            install_system_packages(missing)
        make_environment(distro)
        state = {"environment": wanted["environment"]}
        write_state(state)
    if not (ROOT / "install").is_dir():
        state = {"environment": wanted["environment"]}
    stale = [name for step, name in zip(("messages", "package"), PACKAGES, strict=True) if state.get(step) != wanted[step]]
    if stale:
        colcon_build(stale, distro)
        write_environment(distro)
        check_imports(distro)
        state.update({step: wanted[step] for step in ("messages", "package")})
        write_state(state)
    if state.get("kernels") != wanted["kernels"]:
        warm_up(distro)
        state["kernels"] = wanted["kernels"]
        write_state(state)


def main() -> int:
    """Set up once at a time; return the exit code."""
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
    say(f"ready ({time.monotonic() - start:.1f} s); run anything in it with tools/run COMMAND")
    return 0


if __name__ == "__main__":
    sys.exit(main())
