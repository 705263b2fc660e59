# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A map as a file: arrays of numpy and the provenance as JSON."""

from __future__ import annotations

import json
import zipfile
import zlib
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.physics.coenergy import CoenergyMap

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import BinaryIO

_FORM = 1
_MOST_BYTES = 256 << 20
_NO_ARCHIVE = "its bytes are no archive npz of arrays"
_OBJECTS = "it holds objects of a program, which are never loaded"  # what numpy says tells how
_TOO_LARGE = f"it unpacks to more than {_MOST_BYTES >> 20} MB"
_BROKEN = (
    OSError,
    KeyError,
    ValueError,
    TypeError,
    AttributeError,
    EOFError,
    MemoryError,
    RecursionError,
    zipfile.BadZipFile,
    zlib.error,
)


def write_map(
    found: CoenergyMap, path: Path, write: Callable[[Path, bytes], object] = Path.write_bytes
) -> None:
    """Write a map to a file of numpy's form npz.

    Parameters
    ----------
    found : CoenergyMap
        The map.
    path : Path
        File to write.
    write : callable
        Puts bytes into a file.
    """
    content = BytesIO()
    np.savez_compressed(
        content,
        form=np.array(_FORM),
        coils=np.array(found.coils),
        currents=found.currents,
        positions=found.positions,
        coefficients=found.coefficients,
        provenance=np.array(json.dumps(found.provenance)),
    )
    write(path, content.getvalue())


def read_map(path: Path) -> CoenergyMap:
    """Read a map.

    Raises
    ------
    ValueError
        If the file cannot be read or is no map; names it.
    """
    try:
        with path.open("rb") as opened:
            if not zipfile.is_zipfile(opened):
                raise ValueError(_NO_ARCHIVE)
            opened.seek(0)
            form, found = _read(opened)
    except _BROKEN as err:
        said = _OBJECTS if "pickle" in str(err) else " ".join(str(err).split())
        message = f"{path}: is no map of valve-twin design map ({said})"
        raise ValueError(message) from err
    if found is None:
        message = f"{path}: is a map of form {form}: this version reads form {_FORM}"
        raise ValueError(message)
    return found


def _read(opened: BinaryIO) -> tuple[int, CoenergyMap | None]:
    """Return the form of a map and, where it is known, the map."""
    with np.load(opened, allow_pickle=False) as file:
        if sum(item.file_size for item in file.zip.infolist()) > _MOST_BYTES:
            raise ValueError(_TOO_LARGE)
        held = {name: file[name] for name in file.files}
    form = int(held["form"])
    if form != _FORM:
        return form, None
    return form, CoenergyMap(
        tuple(str(name) for name in held["coils"]),
        held["currents"],
        held["positions"],
        held["coefficients"],
        json.loads(str(held["provenance"])),
    )
