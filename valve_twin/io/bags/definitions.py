# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Find message definitions without ROS: the text of a type with all types it holds, its hash.

Looked up, first hit wins: `msg_defs/msg` of the source tree or of the installed package for our
own messages, the `share/PACKAGE/msg` folders of AMENT_PREFIX_PATH, the ROS 2 Jazzy definitions
that come with rosbags.
"""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path

from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

OWN_PACKAGE = "valve_twin_msgs"

_SEPARATOR = "=" * 80
_LISTS = (Nodetype.ARRAY, Nodetype.SEQUENCE)


@cache
def definition(type_name: str) -> str:
    """Return the definition of a message type followed by those of all types in it ("ros2msg").

    Parameters
    ----------
    type_name : str
        Full name such as "valve_twin_msgs/msg/Float64Stamped".

    Returns
    -------
    str
        As the ROS 2 recorder embeds it.

    Raises
    ------
    KeyError
        If the type, or one that it holds, is found nowhere.
    """
    parts = [_text(type_name)]
    parts += [
        f"{_SEPARATOR}\nMSG: {package}/{name}\n{_text(f'{package}/msg/{name}')}"
        for package, name in (d.split("/msg/") for d in _dependencies(type_name))
    ]
    return "\n".join(part.rstrip("\n") for part in parts) + "\n"


@cache
def type_hash(type_name: str, text: str = "") -> str:
    """Return the REP-2016 hash of a type, "RIHS01_...".

    Parameters
    ----------
    type_name : str
        Full name.
    text : str
        Its full definition; looked up where empty.
    """
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(text or definition(type_name), type_name))
    return store.hash_rihs01(type_name)


def _dependencies(type_name: str) -> list[str]:
    """Return the types that a type holds, each once, in the order of first use."""
    found: dict[str, None] = {}
    waiting = [type_name]
    while waiting:
        current = waiting.pop(0)
        for inner in _held(current):
            if inner not in found:
                found[inner] = None
                waiting.append(inner)
    return list(found)


def _held(type_name: str) -> list[str]:
    _, fields = get_types_from_msg(_text(type_name), type_name)[type_name]
    found: list[str] = []
    for _, (node, about) in fields:
        inner, name = about[0] if node in _LISTS else (node, about)  # type: ignore[str-unpack]
        if inner is Nodetype.NAME and not str(name).endswith("/wstring"):  # unknown to rosbags
            found.append(str(name))
    return found


@cache
def _text(type_name: str) -> str:
    package, _, name = type_name.split("/")
    for folder in _folders(package):
        path = folder / f"{name}.msg"
        if path.is_file():
            return path.read_text(encoding="utf-8")
    store = get_typestore(Stores.ROS2_JAZZY)
    if type_name not in store.fielddefs:
        raise KeyError(type_name)
    text, _ = store.generate_msgdef(type_name, ros_version=2)
    return text.split(_SEPARATOR, 1)[0]


def _folders(package: str) -> list[Path]:
    found = []
    if package == OWN_PACKAGE:
        for parent in Path(__file__).resolve().parents:
            found += [parent / "msg_defs/msg", parent / "share/valve_twin/msg_defs/msg"]
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    found += [Path(prefix) / "share" / package / "msg" for prefix in prefixes if prefix]
    return found
