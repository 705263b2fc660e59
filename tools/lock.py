# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Resolve requirements*.in into lock files for Python 3.10-3.13 that name no download address.

`make lock` keeps the pins that still fit, `make lock UPGRADE=1` renews them all.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
RESOLVER = "uv==0.13.8"
HEADER = "# Pinned for Python 3.10-3.13 from {source} by make lock; do not edit.\n"


def resolve(uv: Path, source: str, lock: str, *constraints: str) -> None:
    """Write one lock file.

    Parameters
    ----------
    uv : Path
        Resolver to call.
    source, lock : str
        Names of the file that lists the wanted packages and of the one that pins them.
    *constraints : str
        Lock files whose pins this one has to share.
    """
    command = [
        str(uv),
        "pip",
        "compile",
        "--universal",
        "--python-version",
        "3.10",
        "--quiet",
        "--no-config",
    ]
    command += [
        "--no-emit-index-url",
        "--no-emit-find-links",
        "--no-header",
        "--no-annotate",
        source,
        "-o",
        lock,
    ]
    command += [word for name in constraints for word in ("-c", name)]
    command += sys.argv[1:]
    environment = {**os.environ, "UV_PYTHON_DOWNLOADS": "never"}
    subprocess.run(command, cwd=ROOT, env=environment, check=True)
    path = ROOT / lock
    path.write_text(
        HEADER.format(source=source) + path.read_text(encoding="utf-8"), encoding="utf-8"
    )
    print(f"lock: wrote {lock}")


def main() -> None:
    """Write both lock files with a resolver of their own."""
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([sys.executable, "-m", "venv", folder], check=True)
        tools = Path(folder, "bin")
        subprocess.run([tools / "python", "-m", "pip", "install", "--quiet", RESOLVER], check=True)
        resolve(tools / "uv", "requirements.in", "requirements.lock")
        resolve(tools / "uv", "requirements-ros.in", "requirements-ros.lock", "requirements.lock")


if __name__ == "__main__":
    main()
