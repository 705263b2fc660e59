# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Whether a subscriber here would read the bytes of a bag as they were meant.

Bytes are published as they were recorded, and a subscriber decodes them with the type that is
installed here: where that type is another one than the bag's, the topic must not be played.
"""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from valve_twin.io.bags.definitions import OWN_PACKAGE, type_hash
from valve_twin.io.limits import CONSTRUCTORS_MEET

_HASH = "RIHS01_"


@dataclass(frozen=True, slots=True)
class BagType:
    """The type of a topic as one file of a bag tells it.

    Attributes
    ----------
    name : str
        Full name, "std_msgs/msg/String".
    encoding : str
        Of the messages, "cdr".
    kind : str
        Of the definition: ros2msg, ros2idl or empty.
    text : str
        Definition with all types in it.
    type_hash : str
        As recorded, "RIHS01_...", empty where the recorder wrote none.
    """

    name: str
    encoding: str
    kind: str
    text: str
    type_hash: str = ""


def problem(found: BagType) -> str:
    """Return why messages of a type cannot be published here, empty where they can."""
    if found.encoding != "cdr":
        return f"its encoding is '{found.encoding}', not ROS 2 (cdr); record it with ROS 2"
    known = installed_hashes(found.name)
    if not known:
        return f"message type {found.name} is not installed; build its package and source it"
    defined = _hash_of(found)
    if not found.text.strip() and defined not in known:
        defined = ""  # no definition rather than that of a type without fields
    stated = [h for h in (found.type_hash, defined) if h.startswith(_HASH)]
    if not stated:
        return f"the bag holds no readable definition of {found.name}; record the topic anew"
    for one in stated:
        if one not in known:
            return (
                f"the bag's {found.name} ({one[:15]}...) is not the installed one "
                f"({known[0][:15]}...); source the version of the package it was recorded with"
            )
    return ""


@cache
def installed_hashes(type_name: str) -> tuple[str, ...]:
    """Return the hashes by which a type that is installed here may be known, empty = none is.

    Parameters
    ----------
    type_name : str
        Full name; that of a service or action part such as "pkg/srv/Name_Event" too.
    """
    parts = type_name.split("/")
    if len(parts) != 3:
        return ()
    built = _built_hash(*parts)
    found = [built] if built else []
    if not built or parts[0] != OWN_PACKAGE:
        # the library's hash differs from the builder's for a few types that hold char
        try:
            found.append(type_hash(type_name))
        except Exception:  # the parser raises what its grammar meets
            return tuple(found)
    return tuple(dict.fromkeys(found))


def _built_hash(package: str, kind: str, name: str) -> str:
    """Return the hash that stands beside an installed type, written when it was built."""
    prefixes = [p for p in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if p]
    for prefix in prefixes:
        path = Path(prefix) / "share" / package / kind / f"{name.partition('_')[0]}.json"
        try:
            table = json.loads(path.read_text(encoding="utf-8"))["type_hashes"]
            hashes = {str(t["type_name"]): str(t["hash_string"]) for t in table}
        except (OSError, *CONSTRUCTORS_MEET):
            continue
        if f"{package}/{kind}/{name}" in hashes:
            return hashes[f"{package}/{kind}/{name}"]
    return ""


@cache
def _hash_of(found: BagType) -> str:
    """Return the hash of the definition in the bag, empty where it cannot be read."""
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    store = get_typestore(Stores.EMPTY)
    try:
        store.register(
            get_types_from_idl(found.text)
            if found.kind == "ros2idl"
            else get_types_from_msg(found.text, found.name)
        )
        return store.hash_rihs01(found.name)
    except Exception:  # the parser raises what its grammar meets
        return ""
