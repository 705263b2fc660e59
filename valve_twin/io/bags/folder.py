# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Find the files of a bag folder, also where its metadata.yaml is damaged."""

from __future__ import annotations

import logging
import re
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from valve_twin.io.bags.metadata import FILE_NAME, ForeignBagError, read_metadata
from valve_twin.io.errors import BagError
from valve_twin.io.mcap.format import MAGIC

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

_LOGGER = logging.getLogger("valve_twin")


@dataclass(frozen=True, slots=True)
class BagFolder:
    """The .mcap files of a bag in their order.

    Attributes
    ----------
    files : tuple of Path
        Its files; those that are missing stand in `missing`.
    custom : dict
        The user's own values.
    missing : tuple of Path
        Files that the metadata names and that are not there.
    flaw : str
        What is wrong with the metadata, empty = nothing.
    counts : mapping
        Messages by topic, as the metadata says; empty where it does not say or is wrong otherwise.
    """

    files: tuple[Path, ...]
    custom: dict[str, str]
    missing: tuple[Path, ...] = ()
    flaw: str = ""
    counts: Mapping[str, int] = field(default_factory=dict)


def find_files(path: str | Path) -> BagFolder:
    """Return the files of a bag: a folder, its metadata.yaml or one .mcap file.

    Raises
    ------
    BagError
        If there is no such bag.
    """
    path = Path(path)
    if not path.is_dir() and path.name != FILE_NAME:
        return BagFolder((path,), {})
    folder = path if path.is_dir() else path.parent
    present = tuple(sorted(folder.glob("*.mcap"), key=natural_order))
    if not (folder / FILE_NAME).is_file():
        if not present:
            msg = f"{path}: holds no .mcap file; give a bag folder with MCAP storage"
            raise BagError(msg)
        return BagFolder(present, {})
    try:
        metadata = read_metadata(folder / FILE_NAME)
    except ForeignBagError:
        raise
    except BagError as err:
        if not any(map(_is_mcap, present)):
            raise
        return BagFolder(present, {}, flaw=f"{err}; all .mcap files of the folder are read")
    named = Counter(_place(folder, name) for name in metadata.files)
    twice = _names(folder, (p for p, count in named.items() if count > 1))
    missing = tuple(p for p in named if not p.is_file())
    spare = [p for p in present if p not in named]
    flaws = [f"names {twice} twice; it is read once"] if twice else []
    files = tuple(named)
    if missing and spare:
        there, gone = _names(folder, spare), _names(folder, missing)
        flaws.append(f"names {gone}, which is not there; read instead: {there}")
        files = tuple(sorted([p for p in named if p.is_file()] + spare, key=natural_order))
        missing = ()
    elif spare:
        flaws.append(f"does not name {_names(folder, spare)}, which is left out")
    flaw = f"{folder / FILE_NAME}: {'; '.join(flaws)}" if flaws else ""
    counts = {} if flaws or missing else dict(metadata.counts)
    return BagFolder(files, dict(metadata.custom), missing, flaw, counts)


def _place(folder: Path, name: str) -> Path:
    """Return where a named file is: below the folder, else in it, as old bags name theirs."""
    path = Path(name)
    is_below = not path.is_absolute() and ".." not in path.parts
    return folder / path if is_below and (folder / path).is_file() else folder / path.name


def _names(folder: Path, paths: Iterable[Path]) -> str:
    return ", ".join(str(p.relative_to(folder)) for p in paths)


def bag_folder(path: str | Path) -> BagFolder:
    """Return what `find_files` finds; say on the log what is wrong with the metadata.

    Raises
    ------
    BagError
        If there is no such bag.
    """
    found = find_files(path)
    if found.flaw:
        _LOGGER.warning("%s", found.flaw)
    return found


def bag_files(path: str | Path) -> tuple[tuple[Path, ...], dict[str, str]]:
    """Return the .mcap files of a bag in their order and the user's own values in its metadata.

    Raises
    ------
    BagError
        If there is no such bag.
    """
    found = bag_folder(path)
    return found.files, found.custom


def natural_order(path: Path) -> list[tuple[bool, int, str]]:
    """Sort key that puts bag_2 before bag_10."""
    parts = re.split(r"(\d+)", path.name)
    return [(p.isdigit(), int(p) if p.isdigit() else 0, p) for p in parts]


def _is_mcap(path: Path) -> bool:
    try:
        with path.open("rb") as stream:
            return stream.read(len(MAGIC)) == MAGIC
    except OSError:
        return False
