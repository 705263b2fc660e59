# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""metadata.yaml of a rosbag2 folder."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import TYPE_CHECKING

import yaml

from valve_twin.io.errors import BagError
from valve_twin.io.limits import load_yaml

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from valve_twin.io.bags.qos import QosProfile

FILE_NAME = "metadata.yaml"
VERSION = 9
"""What the ROS 2 Jazzy recorder writes."""

_DISTRO = ("ROS_DISTRO", "VALVE_TWIN_ROS")
_ROOT = "rosbag2_bagfile_information"


class ForeignBagError(BagError):
    """A bag of a known kind that is not read; another word may be a damaged one."""


@dataclass(frozen=True, slots=True)
class TopicEntry:
    """One topic of a bag with its message count."""

    name: str
    type: str
    type_hash: str
    qos: tuple[QosProfile, ...]
    count: int


@dataclass(frozen=True, slots=True)
class FileEntry:
    """One file of a bag; times in ns."""

    name: str
    start_ns: int
    duration_ns: int
    count: int


def metadata_map(
    files: Sequence[FileEntry], topics: Sequence[TopicEntry], custom: Mapping[str, str]
) -> dict[str, object]:
    """Return the content of a metadata.yaml below its root key.

    Parameters
    ----------
    files : sequence of FileEntry
        Its files in their order.
    topics : sequence of TopicEntry
        Its topics.
    custom : mapping
        Values of the user's own.
    """
    filled = [f for f in files if f.count]
    start = min((f.start_ns for f in filled), default=0)
    end = max((f.start_ns + f.duration_ns for f in filled), default=0)
    return {
        "version": VERSION,
        "storage_identifier": "mcap",
        "duration": {"nanoseconds": end - start},
        "starting_time": {"nanoseconds_since_epoch": start},
        "message_count": sum(f.count for f in files),
        "topics_with_message_count": [
            {
                "topic_metadata": {
                    "name": t.name,
                    "type": t.type,
                    "serialization_format": "cdr",
                    "offered_qos_profiles": [p.as_map() for p in t.qos],
                    "type_description_hash": t.type_hash,
                },
                "message_count": t.count,
            }
            for t in topics
        ],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [f.name for f in files],
        "files": [
            {
                "path": f.name,
                "starting_time": {"nanoseconds_since_epoch": f.start_ns},
                "duration": {"nanoseconds": f.duration_ns},
                "message_count": f.count,
            }
            for f in files
        ],
        "custom_data": dict(custom) or None,
        "ros_distro": next(filter(None, map(os.environ.get, _DISTRO)), "jazzy"),
    }


def metadata_text(content: Mapping[str, object]) -> str:
    """Return the text of a metadata.yaml."""
    return yaml.safe_dump({_ROOT: dict(content)}, sort_keys=False)


@dataclass(frozen=True, slots=True)
class BagMetadata:
    """What a metadata.yaml says: files in order, messages by topic, the user's own values."""

    files: tuple[str, ...]
    counts: Mapping[str, int]
    custom: Mapping[str, str]


def read_metadata(path: Path) -> BagMetadata:
    """Read a metadata.yaml of any version.

    Raises
    ------
    BagError
        If it is none, names no files, or the bag is of a kind that is not read.
    """
    try:
        root = load_yaml(path.read_text(encoding="utf-8"))
        content = root[_ROOT]
        files = tuple(str(f) for f in content.get("relative_file_paths") or ())
        counts = {
            str(t["topic_metadata"]["name"]): int(t["message_count"])
            for t in content.get("topics_with_message_count") or ()
        }
        storage = str(content.get("storage_identifier", "mcap"))
        mode = str(content.get("compression_mode") or "").lower()
        custom = content.get("custom_data") or {}
        custom = {str(k): str(v) for k, v in dict(custom).items()}
    except (
        OSError,
        yaml.YAMLError,
        ValueError,
        OverflowError,
        TypeError,
        KeyError,
        AttributeError,
    ) as err:
        msg = f"{path}: is no metadata.yaml of a ROS 2 bag; give the .mcap file itself"
        raise BagError(msg) from err
    if storage != "mcap":
        msg = (
            f"{path}: storage '{storage}' is not read; convert it to MCAP with 'ros2 bag convert'"
        )
        raise (ForeignBagError if storage == "sqlite3" else BagError)(msg)
    if mode not in {"", "none", "storage"}:
        msg = (
            f"{path}: {mode} compression around MCAP is not read; "
            "convert it with 'ros2 bag convert' and compression inside MCAP"
        )
        raise (ForeignBagError if mode in {"file", "message"} else BagError)(msg)
    if not files:
        msg = f"{path}: names no files; give the .mcap file itself"
        raise BagError(msg)
    return BagMetadata(files, counts, custom)
