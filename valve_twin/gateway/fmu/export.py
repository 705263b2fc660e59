# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Compile a valve for Linux and Windows and write it with its sources as an FMU."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import zipfile
from importlib import resources
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

from valve_twin.gateway.fmu.description import SOURCES, build_description, model_description
from valve_twin.io.errors import FmuError
from valve_twin.io.whole import write_whole

if TYPE_CHECKING:
    from collections.abc import Mapping

    from valve_twin.gateway.fmu.valve import FmuValve

_TARGETS = {"linux64": ("x86_64-linux-gnu.2.17", ".so"), "win64": ("x86_64-windows-gnu", ".dll")}
"""Target of the compiler and ending of the binary, by the platform as FMI 2.0 names it."""

_NAMES_3 = {"linux64": "x86_64-linux", "win64": "x86_64-windows"}
_MISSING = "{} is missing: pip install valve_twin[fmu]"
_STAMP = (1980, 1, 1, 0, 0, 0)  # of the files inside: the same valve gives the same bytes
_HEADERS = {
    2: ("fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h"),
    3: ("fmi3Functions.h", "fmi3FunctionTypes.h", "fmi3PlatformTypes.h"),
}
_FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-fno-sanitize=all", "-shared", "-s")


def write_fmu(valve: FmuValve, path: Path, version: int) -> None:
    """Write an FMU with its sources and the binaries of linux64 and win64.

    Parameters
    ----------
    valve : FmuValve
        The valve.
    path : Path
        File to write; what is there is replaced when the new one is whole.
    version : int
        2 or 3, of FMI.

    Raises
    ------
    FmuError
        If a package of the extra `fmu` is missing, or the compiler refuses the C.
    """
    files = _sources(valve, version)
    description = model_description(valve, version)
    binaries = _compiled(valve, files, version)
    inside: dict[str, bytes] = {"modelDescription.xml": description, **binaries}
    inside |= {f"sources/{name}": text for name, text in files.items()}
    inside["documentation/licenses/license.txt"] = _LICENCE
    if version == 3:
        inside["sources/buildDescription.xml"] = build_description(valve)
    packed = BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in inside.items():
            info = zipfile.ZipInfo(name, _STAMP)
            info.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(info, content)
    write_whole(path, packed.getvalue())


def _sources(valve: FmuValve, version: int) -> dict[str, bytes]:
    """Return the sources by name: ours, the law, and the headers of the standard."""
    spec = find_spec("fmpy")
    if spec is None or spec.origin is None:
        msg = _MISSING.format("fmpy")
        raise FmuError(msg)
    headers = Path(spec.origin).parent / "c-code"
    ours = resources.files("valve_twin.gateway.fmu") / "c"
    found = {"law.h": valve.code.encode()}
    found |= {name: (ours / name).read_bytes() for name in ("model.h", *SOURCES[version])}
    return found | {name: (headers / name).read_bytes() for name in _HEADERS[version]}


def _compiled(valve: FmuValve, files: Mapping[str, bytes], version: int) -> dict[str, bytes]:
    """Return the binaries by their name in the FMU."""
    if find_spec("ziglang") is None:
        msg = _MISSING.format("ziglang")
        raise FmuError(msg)
    found = {}
    with tempfile.TemporaryDirectory(prefix="valve_twin_fmu_") as folder:
        for name, text in files.items():
            Path(folder, name).write_bytes(text)
        for platform, (target, ending) in _TARGETS.items():
            out = Path(folder, f"{valve.identifier}{ending}")
            command = [sys.executable, "-m", "ziglang", "cc", "-target", target, *_FLAGS]
            command += [*SOURCES[version], "-o", out.name]
            command += ["-lm", "-fPIC"] if ending == ".so" else []
            environment = {**os.environ, "LD_LIBRARY_PATH": ""}
            done = subprocess.run(
                command, cwd=folder, env=environment, capture_output=True, text=True, check=False
            )
            if done.returncode or not out.is_file():
                lines = [line for line in done.stderr.splitlines() if "error" in line]
                why = (lines or done.stderr.splitlines() or ["no reason was given"])[0]
                msg = f"{platform}: the compiler refused the law: {why}"
                raise FmuError(msg)
            place = platform if version == 2 else _NAMES_3[platform]
            found[f"binaries/{place}/{out.name}"] = out.read_bytes()
    return found


_LICENCE = b"""\
valve_twin: Apache-2.0, see https://www.apache.org/licenses/LICENSE-2.0
sources/fmi*.h: the headers of the FMI standard, 2-Clause BSD, Copyright Modelica Association
Project "FMI" and others; the text of the licence stands in each of them.
"""
