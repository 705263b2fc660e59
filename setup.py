# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Install valve_twin as an ament_python package; run by colcon."""

import subprocess
from pathlib import Path

from setuptools import find_packages, setup
from setuptools.command.develop import develop
from setuptools.command.install_scripts import install_scripts

PACKAGE = "valve_twin"
SHARE = f"share/{PACKAGE}"
NODES = (
    "aging_monitor",
    "bag_player",
    "bag_recorder",
    "gateway",
    "opcua_source",
    "simulated_valve",
    "twin",
)
LAWS = ("first_order", "integrator")  # valves of one file
VALVES = (
    "cycle_timing",
    "damadics",
    "double_solenoid",
    "hammerstein_wiener",
    "hybrid_actuator",
    "hydraulic_actuator",
    "positioner",
    "press_cartridge",
    "servo_system",
    "stepper_servo",
)


def share_files(folder: str, *patterns: str) -> tuple[str, list[str]]:
    """Return the data_files entry that puts a folder's files under share/valve_twin."""
    found = sorted(str(path) for pattern in patterns for path in Path(folder).glob(pattern))
    return f"{SHARE}/{folder}", found


ENV = "/usr/bin/env"
PUT_OFF = ("--block-signal=TERM", "--block-signal=INT")
NODE_SCRIPT = """{first}
# A signal that comes before the node has its handlers waits for them where `env` can see to it.
import sys

from valve_twin.nodes.runtime.executables import {name}

if __name__ == "__main__":  # not in the processes that the node starts
    sys.exit({name}())
"""


def first_line(given: str) -> str:
    """Return a script's first line with the signals put off, as it was where `env` cannot."""
    python = given.removeprefix("#!").strip()
    line = f"#!{ENV} -S {' '.join(PUT_OFF)} {python}"
    if len(python.split()) != 1 or len(line) > 127:
        return given
    try:
        subprocess.run([ENV, *PUT_OFF, "true"], check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        return given
    return line


def node_script(name: str, contents: str) -> str:
    """Return the script of an executable: a node's starts without a search for its package."""
    if name not in NODES:
        return contents
    return NODE_SCRIPT.format(first=first_line(contents.splitlines()[0]), name=name)


class Develop(develop):
    """Writes the scripts of a symlink install."""

    def write_script(self, script_name: str, contents: str, *rest: str) -> None:
        """Write one."""
        super().write_script(script_name, node_script(script_name, contents), *rest)


class InstallScripts(install_scripts):
    """Writes the scripts of a plain install."""

    def write_script(self, script_name: str, contents: str, *rest: str) -> None:
        """Write one."""
        super().write_script(script_name, node_script(script_name, contents), *rest)


setup(
    name=PACKAGE,
    version="0.1.0",
    description="Digital twins of valves: parameters, prediction, residual and aging trend",
    maintainer="valve_twin maintainers",
    maintainer_email="maintainers@example.com",
    license="Apache-2.0",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={
        PACKAGE: [
            "py.typed",
            "**/*.mako",
            "**/*.sql",
            "**/*.json",
            "**/*.yaml",
            "**/*.css",
            "**/*.js",
            "**/*.po",
            "**/*.html",
            "**/*.xml",
            "**/*.msg",
            "**/*.c",
            "**/*.h",
        ]
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (SHARE, ["package.xml"]),
        share_files("launch", "*.launch.py"),
        share_files("config", "*.yaml"),
        share_files("layouts", "*.xml", "*.json"),
        share_files("deploy/sros2", "*.xml"),
        share_files("deploy/systemd", "*.service", "environment"),
        share_files("msg_defs/msg", "*.msg"),  # bags are written without ROS, too
        ("bin", ["tools/valve-twin"]),
    ],
    cmdclass={"develop": Develop, "install_scripts": InstallScripts},
    zip_safe=False,
    python_requires=">=3.10,<3.14",
    install_requires=[
        "alembic",
        "daqp",
        "jinja2",
        "lz4",
        "markupsafe",
        "mcap",
        "numba",
        "numpy",
        "pyyaml",
        "rich",
        "rosbags",
        "scipy",
        "sqlalchemy>=2",
        "zstandard",
    ],
    extras_require={
        "cvxpy": ["cvxpy"],
        "dask": ["distributed"],
        "design": ["distributed", "ezdxf", "pymoo", "salib", "scikit-fem"],
        "fast": ["isal"],
        "files": ["asammdf", "charset-normalizer", "h5py", "nptdms", "openpyxl"],
        "fmu": ["fmpy", "ziglang"],
        "gateway": [
            "asyncua",
            "foxglove-sdk",
            "paho-mqtt",
            "prometheus-client",
            "pysparkplug",
            "starlette",
            "uvicorn",
        ],
        "parquet": ["pyarrow"],
        "postgresql": ["psycopg[binary]"],
        "test": ["hypothesis", "pytest", "pytest-timeout"],
    },
    entry_points={
        "console_scripts": [
            "valve-twin = valve_twin.cli:main",
            *(f"{node} = valve_twin.nodes.runtime.executables:{node}" for node in NODES),
        ],
        "valve_twin.valves": [
            *(f"{law} = valve_twin.core.valves.{law}:VALVE" for law in LAWS),
            *(f"{valve} = valve_twin.core.valves.{valve}:MODEL" for valve in VALVES),
        ],
    },
)
