# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Parameter files that a node cannot be meant to start with are told in one line."""

import pytest

from valve_twin.io.config.node_arguments import check_arguments
from valve_twin.io.errors import ConfigError

GOOD = "  ros__parameters:\n    model: press_cartridge\n"
NS = ["-r", "__ns:=/press/v1"]


def arguments(tmp_path, text, *more):
    path = tmp_path / "valves.yaml"
    if text is not None:
        path.write_text(text)
    return ["--ros-args", *more, "--params-file", str(path)]


@pytest.mark.parametrize("section", ["/**", "/press/v1/twin", "/**/twin", "/press/*/twin"])
def test_a_file_for_this_node_is_taken(tmp_path, section):
    assert not check_arguments("twin", arguments(tmp_path, f"{section}:\n{GOOD}", *NS))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (None, "there is no such file"),
        ("", "no section with 'ros__parameters:'"),
        ("model: press_cartridge\n", "no section with 'ros__parameters:'"),
        ("/**:\n  ros__parameter:\n    model: a\n", "stands outside 'ros__parameters:'"),
        ("/**:\n  model: a\n", "stands outside 'ros__parameters:'"),
        ("/**:\n  ros__parameters:\n    model: [a\n", "is not valid YAML"),
        (f"/other/twin:\n{GOOD}", "holds nothing for /press/v1/twin, only for /other/twin"),
        (f"twin:\n{GOOD}", "holds nothing for /press/v1/twin, only for /twin"),
    ],
)
def test_what_is_wrong_with_a_file_is_one_line_with_its_name(tmp_path, text, words):
    with pytest.raises(ConfigError) as caught:
        check_arguments("twin", arguments(tmp_path, text, *NS))
    assert words in str(caught.value)
    assert "valves.yaml" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_of_several_files_a_twin_takes_what_is_for_it(tmp_path):
    other, own = tmp_path / "others.yaml", tmp_path / "own.yaml"
    other.write_text(f"/press/v2/twin:\n{GOOD}")
    own.write_text(f"/press/v1/twin:\n{GOOD}")
    for files in ((other, own), (own, other)):
        given = [word for path in files for word in ("--params-file", str(path))]
        warning = check_arguments("twin", ["--ros-args", *NS, *given])
        assert f"{other}: holds nothing for /press/v1/twin" in warning
        assert str(own) not in warning
    with pytest.raises(ConfigError, match=r"others.yaml: holds .*others.yaml: holds"):
        check_arguments("twin", ["--ros-args", *NS, *("--params-file", str(other)) * 2])


def test_a_node_that_needs_no_file_of_a_valve_is_only_told(tmp_path):
    given = arguments(tmp_path, f"/press/v1/twin:\n{GOOD}", *NS)
    assert "holds nothing for /press/v1/bag_recorder" in check_arguments("bag_recorder", given)


@pytest.mark.parametrize("remap", ["__node:=mine", "__name:=mine", "twin:__node:=mine"])
def test_the_name_that_the_command_line_gives_is_the_nodes(tmp_path, remap):
    given = arguments(tmp_path, f"/press/v1/mine:\n{GOOD}", *NS, "--remap", remap)
    assert not check_arguments("twin", given)
    with pytest.raises(ConfigError):
        check_arguments("twin", arguments(tmp_path, f"/press/v1/twin:\n{GOOD}", *NS, "-r", remap))
