# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Install valve_twin as an ament_python package; run by colcon."""

from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = "valve_twin"
SHARE = f"share/{PACKAGE}"
NODES = ("aging_monitor", "bag_player", "bag_recorder", "simulated_valve", "twin")


def share_files(folder: str, *patterns: str) -> tuple[str, list[str]]:
    """Return the data_files entry that puts a folder's files under share/valve_twin."""
    found = sorted(str(path) for pattern in patterns for path in Path(folder).glob(pattern))
    return f"{SHARE}/{folder}", found


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
            "**/*.html",
            "**/*.msg",
        ]
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (SHARE, ["package.xml"]),
        share_files("launch", "*.launch.py"),
        share_files("config", "*.yaml"),
        share_files("layouts", "*.xml", "*.json"),
        share_files("msg_defs/msg", "*.msg"),  # bags are written without ROS, too
        ("bin", ["tools/valve-twin"]),
    ],
    zip_safe=False,
    python_requires=">=3.10,<3.14",
    install_requires=[
        "alembic",
        "cvxpy",
        "daqp",
        "lz4",
        "mcap",
        "numba",
        "numpy",
        "pyyaml",
        "rich",
        "rosbags",
        "scipy",
        "setuptools",
        "sqlalchemy",
        "zstandard",
    ],
    extras_require={
        "dask": ["distributed"],
        "parquet": ["pyarrow"],
        "postgresql": ["psycopg[binary]"],
        "test": ["hypothesis", "pytest", "pytest-timeout"],
    },
    entry_points={
        "console_scripts": [
            "valve-twin = valve_twin.cli:main",
            *(f"{node} = valve_twin.nodes.executables:{node}" for node in NODES),
        ],
    },
)
