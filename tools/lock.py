# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Resolve requirements*.in into lock files for Python 3.10-3.13 that name no download address.

From them the bill of materials (CycloneDX) is written, which names none either.

`make lock` keeps the pins that still fit, `make lock UPGRADE=1` renews them all.
"""

import json
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
RESOLVER = "uv==0.13.8"
LOCKS = ("requirements.lock", "requirements-ros.lock")
ROS = ("requirements-ros", "requirements-ros-kilted")
BILL = "sbom.cdx.json"
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


def bill_of_materials() -> str:
    """Return what the lock files pin as a CycloneDX document."""
    version = re.search(r'version="([^"]+)"', (ROOT / "setup.py").read_text(encoding="utf-8"))
    pinned = set()
    for lock in LOCKS:
        text = (ROOT / lock).read_text(encoding="utf-8")
        pinned |= set(re.findall(r"^([\w.-]+)(?:\[[^]]*\])?==([\w.+!-]+)", text, re.MULTILINE))
    components = [
        {
            "type": "library",
            "name": name,
            "version": number,
            "purl": f"pkg:pypi/{name}@{number}",
            "bom-ref": f"pkg:pypi/{name}@{number}",
        }
        for name, number in sorted(pinned)
    ]
    document = {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {
            "component": {
                "type": "application",
                "name": "valve_twin",
                "version": version.group(1) if version else "",
                "licenses": [{"license": {"id": "Apache-2.0"}}],
                "bom-ref": "valve_twin",
            }
        },
        "components": components,
    }
    return json.dumps(document, indent=1) + "\n"


def main() -> None:
    """Write the lock files with a resolver of their own."""
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([sys.executable, "-m", "venv", folder], check=True)
        tools = Path(folder, "bin")
        subprocess.run([tools / "python", "-m", "pip", "install", "--quiet", RESOLVER], check=True)
        resolve(tools / "uv", "requirements.in", "requirements.lock")
        for ros in ROS:
            resolve(tools / "uv", f"{ros}.in", f"{ros}.lock", "requirements.lock")
    (ROOT / BILL).write_text(bill_of_materials(), encoding="utf-8")
    print(f"lock: wrote {BILL}")


if __name__ == "__main__":
    main()
