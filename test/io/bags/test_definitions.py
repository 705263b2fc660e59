# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
from pathlib import Path

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from valve_twin.io.bags.definitions import _folders, definition, type_hash

OWN = ["CycleSummary", "Estimate", "Float64Series", "Float64Stamped", "Prediction", "Trend"]


@pytest.mark.parametrize("name", OWN)
def test_embeds_the_text_of_msg_defs(root, name):
    text = (root / "msg_defs" / "msg" / f"{name}.msg").read_text(encoding="utf-8")
    assert definition(f"valve_twin_msgs/msg/{name}").startswith(text.rstrip("\n"))


@pytest.mark.parametrize("name", OWN)
def test_definition_is_complete(name):
    full = f"valve_twin_msgs/msg/{name}"
    types = get_types_from_msg(definition(full), full)
    assert set(types) >= {full, "std_msgs/msg/Header", "builtin_interfaces/msg/Time"}


def test_every_own_message_has_a_definition(root):
    for path in (root / "msg_defs" / "msg").glob("*.msg"):
        name = f"valve_twin_msgs/msg/{path.stem}"
        assert type_hash(name).startswith("RIHS01_")


@pytest.mark.parametrize("name", ["std_msgs/msg/Header", "sensor_msgs/msg/JointState"])
def test_hash_is_that_of_the_standard_type(name):
    assert type_hash(name) == get_typestore(Stores.ROS2_JAZZY).hash_rihs01(name)


def test_hash_is_that_of_the_built_package():
    package = pytest.importorskip("valve_twin_msgs.msg", reason="messages are not built")
    built = getattr(package.Float64Stamped, "_TYPE_HASH", None)  # Jazzy keeps it in the .json file
    prefix = Path(package.__file__).parents[5]
    folder = prefix / "share/valve_twin_msgs/msg"
    if built is None and (folder / "Float64Stamped.json").is_file():
        import json

        content = json.loads((folder / "Float64Stamped.json").read_text(encoding="utf-8"))
        built = content["type_hashes"][0]["hash_string"]
    if built is None:
        pytest.skip("the built package does not say its type hash")
    assert type_hash("valve_twin_msgs/msg/Float64Stamped") == built


def test_an_unknown_type_is_a_key_error():
    with pytest.raises(KeyError, match="nowhere_msgs"):
        definition("nowhere_msgs/msg/Nothing")


def test_an_installed_package_carries_the_texts(root):
    setup = (root / "setup.py").read_text(encoding="utf-8")
    assert 'share_files("msg_defs/msg", "*.msg")' in setup
    assert [
        str(f).endswith("share/valve_twin/msg_defs/msg") for f in _folders("valve_twin_msgs")
    ].count(True)
