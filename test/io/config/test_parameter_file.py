# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
import pytest

from valve_twin.io.config.parameter_file import Section, read_parameter_file
from valve_twin.io.errors import ConfigError


def read(tmp_path, text):
    path = tmp_path / "valve.yaml"
    path.write_text(text, encoding="utf-8")
    return read_parameter_file(path)


def test_gives_flat_names_with_their_lines(tmp_path):
    (section,) = read(tmp_path, "/**:\n  ros__parameters:\n    a:\n      b: 1\n    c.d: x\n")
    assert section.pattern == "/**"
    assert section.values == {"a.b": 1, "c.d": "x"}
    assert section.lines == {"a.b": 4, "c.d": 5}


def test_nested_and_joined_node_names_are_the_same(tmp_path):
    text = "press:\n  valve_1:\n    twin:\n      ros__parameters: {a: 1}\n"
    (nested,) = read(tmp_path, text)
    (joined,) = read(tmp_path, "/press/valve_1/twin:\n  ros__parameters: {a: 1}\n")
    assert nested.pattern == joined.pattern == "/press/valve_1/twin"
    assert joined.namespace == "/press/valve_1"


MATCHES = [
    ("/**", "/twin", True),
    ("/**", "/a/b/twin", True),
    ("/**/twin", "/a/b/twin", True),
    ("/**/twin", "/twin", True),
    ("/**/twin", "/a/twin_2", False),
    ("/a/*/twin", "/a/b/twin", True),
    ("/a/*/twin", "/a/b/c/twin", False),
    ("/a/twin", "/a/twin", True),
    ("/a/twin", "/b/twin", False),
]


@pytest.mark.parametrize(("pattern", "node", "matches"), MATCHES)
def test_patterns_match_as_in_ros(pattern, node, matches):
    assert Section(pattern).matches(node) is matches


VALUES = [
    ("1", 1),
    ("1.0", 1.0),
    ("1e-3", 0.001),
    ("-2.5E6", -2.5e6),
    ("'1e-3'", "1e-3"),
    (".inf", float("inf")),
    ("true", True),
    ("abc", "abc"),
    ("[1, 2.5]", [1, 2.5]),
    ("['']", [""]),
]


@pytest.mark.parametrize(("text", "value"), VALUES)
def test_values_are_those_that_ros_reads(tmp_path, text, value):
    (section,) = read(tmp_path, f"/**:\n  ros__parameters:\n    a: {text}\n")
    assert section.values["a"] == value
    assert type(section.values["a"]) is type(value)


BAD = [
    ("a: 1\n", r"valve.yaml: no section with 'ros__parameters:'; write '/\*\*:' in the first"),
    ("", r"valve.yaml: no section with 'ros__parameters:'"),
    ("/**:\n  ros__parameters: 5\n", r"valve.yaml:2: 'ros__parameters' holds no keys"),
    ("/**:\n  ros__parameters:\n    a: 1\n    b: 2\n    a: 3\n",
     r"valve.yaml:5: key 'a' stands twice, first in line 3; remove one"),
    ("/**:\n  ros__parameters:\n    a: [1, 2\n", r"valve.yaml: is not valid YAML \(line \d"),
    ("a: b: c\n", r"valve.yaml: is not valid YAML \(line 1: mapping values"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "says"), BAD)
def test_what_cannot_be_read_is_named_with_its_line(tmp_path, text, says):
    with pytest.raises(ConfigError, match=says) as caught:
        read(tmp_path, text)
    assert "\n" not in str(caught.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(ConfigError, match=r"none.yaml: there is no such file; give the path"):
        read_parameter_file(tmp_path / "none.yaml")


def test_a_file_that_is_no_text_is_named(tmp_path):
    (tmp_path / "a.yaml").write_bytes(b"\xff\xfe\x00\x80")
    with pytest.raises(ConfigError, match=r"a.yaml: cannot be read"):
        read_parameter_file(tmp_path / "a.yaml")


@pytest.mark.parametrize("text", ["1:30", "1_000", "0x10", "010", "0b11"])
def test_a_number_that_people_read_otherwise_is_told(text, yaml_file):
    path = yaml_file(f"period_s: {text}")
    with pytest.raises(ConfigError, match=r":3: key 'period_s': .*to YAML"):
        read_parameter_file(path)


def test_an_empty_map_is_no_value(yaml_file):
    with pytest.raises(ConfigError, match=r":3: key 'period_s' holds no value"):
        read_parameter_file(yaml_file("period_s: {}"))
