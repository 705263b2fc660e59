# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the files of a bag of storage sqlite3 hold beside what is read of them.

Their rows stand under no check sum, and a row that lacks its topic, its index entry or the file
named in metadata.yaml is passed over by a query without a word. All that is counted here is told.
"""

from __future__ import annotations

import sqlite3
from contextlib import closing
from dataclasses import dataclass
from typing import TYPE_CHECKING

import yaml

from valve_twin.io.errors import BagError
from valve_twin.io.limits import load_yaml

if TYPE_CHECKING:
    from pathlib import Path

_LOGS = ("-wal", "-journal")
"""Files beside a database: what its writer had yet to write into it, or to take back."""


@dataclass(frozen=True, slots=True)
class Stored:
    """What stands in the files of a bag: messages, and a line for each doubt."""

    messages: int
    notices: tuple[str, ...]


def look_at(folder: Path) -> Stored:
    """Return what a bag holds, whatever a reader makes of it.

    Parameters
    ----------
    folder : path
        Of metadata.yaml and .db3 files.

    Raises
    ------
    BagError
        If metadata.yaml is none, or its files are packed as a whole.
    """
    named, claimed = _metadata(folder / "metadata.yaml")
    files = sorted(folder.glob("*.db3"))
    notices = [f"{file}: is not named in metadata.yaml and left out" for file in files
               if file.name not in named]  # fmt: skip
    total = 0
    for file in files:
        if file.name in named:
            count, problems = _content(file)
            total += count
            notices += [f"{file}: {problem}" for problem in problems]
    if claimed != total:
        notices.append(f"{folder}: metadata.yaml counts {claimed} messages, its files {total}")
    return Stored(total, tuple(notices))


def _metadata(path: Path) -> tuple[set[str], int]:
    """Return the names of the files and the number of messages that metadata.yaml tells."""
    try:
        content = load_yaml(path.read_text(encoding="utf-8"))["rosbag2_bagfile_information"]
        names = {str(name).rpartition("/")[2] for name in content["relative_file_paths"]}
        claimed = int(content["message_count"])
        mode = str(content.get("compression_mode") or "").lower()
    except FileNotFoundError as err:
        msg = f"{path.parent}: has no metadata.yaml; make it with 'ros2 bag reindex'"
        raise BagError(msg) from err
    except (OSError, yaml.YAMLError, ValueError, OverflowError, TypeError, LookupError,
            AttributeError) as err:  # fmt: skip
        msg = f"{path}: is no metadata.yaml of a ROS 2 bag; make it anew with 'ros2 bag reindex'"
        raise BagError(msg) from err
    if mode == "file":
        msg = f"{path.parent}: its files are packed as a whole; unpack it with 'ros2 bag convert'"
        raise BagError(msg)
    return names, claimed


def _content(file: Path) -> tuple[int, list[str]]:
    """Return how many messages a file holds and what is wrong with it."""
    found = []
    for log in _LOGS:
        beside = file.with_name(file.name + log)
        if beside.is_file() and beside.stat().st_size:
            found.append(
                f"{beside.name} beside it is not read: its recorder was killed; put both in order"
                f" with sqlite3 {file.name} 'PRAGMA wal_checkpoint(TRUNCATE)'"
            )
    with closing(sqlite3.connect(f"{file.absolute().as_uri()}?immutable=1", uri=True)) as database:
        problem = database.execute("PRAGMA integrity_check(1)").fetchone()[0]
        if problem != "ok":
            found.append(f"is damaged ({' '.join(str(problem).split())})")
        (count,) = database.execute("SELECT count(*) FROM messages NOT INDEXED").fetchone()
    return int(count), found
