# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A recorder of one valve: everything, in files of limited size, or snapshots on alarm."""

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments and start the recorder."""
    return LaunchDescription([*_arguments(), _recorder()])


def _arguments() -> list[DeclareLaunchArgument]:
    return [
        DeclareLaunchArgument(
            "namespace",
            default_value="/press/valve_1",
            description="Namespace of the recorder, which names the valve",
        ),
        DeclareLaunchArgument(
            "params_file",
            default_value=PathJoinSubstitution(
                [FindPackageShare("valve_twin"), "config", "press_cartridge.yaml"]
            ),
            description="YAML file with further parameters of the recorder",
        ),
        DeclareLaunchArgument(
            "bag",
            default_value="",
            description="Folder of the bag; empty = valve_twin_DATE here",
        ),
        DeclareLaunchArgument(
            "regex",
            default_value="",
            description="Record topics in whose name this is found; empty = the namespace",
        ),
        DeclareLaunchArgument(
            "max_bag_size",
            default_value="0",
            description="Bytes after which a new file begins; 0 = never",
        ),
        DeclareLaunchArgument(
            "max_bag_duration",
            default_value="0.0",
            description="Seconds after which a new file begins; 0 = never",
        ),
        DeclareLaunchArgument(
            "keep_files",
            default_value="0",
            description="Files kept, older ones are deleted; 0 = all",
        ),
        DeclareLaunchArgument(
            "snapshot_mode",
            default_value="false",
            choices=["true", "false"],
            description="Write only what was last, on the service snapshot or an alarm",
        ),
        DeclareLaunchArgument(
            "snapshot_s",
            default_value="60.0",
            description="Seconds that a snapshot spans at most",
        ),
        DeclareLaunchArgument(
            "snapshot_cycles",
            default_value="0",
            description="Whole cycles in a snapshot; 0 = all that is buffered",
        ),
        DeclareLaunchArgument(
            "use_sim_time",
            default_value="false",
            choices=["true", "false"],
            description="Take the time from /clock instead of the computer",
        ),
        DeclareLaunchArgument(
            "autostart",
            default_value="true",
            choices=["true", "false"],
            description="Configure and activate the node by itself",
        ),
        DeclareLaunchArgument(
            "log_level",
            default_value="info",
            choices=["debug", "info", "warn", "error", "fatal"],
            description="Least severity that the node logs",
        ),
    ]


def _recorder() -> Node:
    return Node(
        package="valve_twin",
        executable="bag_recorder",
        name="bag_recorder",
        namespace=LaunchConfiguration("namespace"),
        parameters=[
            LaunchConfiguration("params_file"),
            {
                "bag": ParameterValue(LaunchConfiguration("bag"), value_type=str),
                "regex": ParameterValue(LaunchConfiguration("regex"), value_type=str),
                "max_bag_size": ParameterValue(
                    LaunchConfiguration("max_bag_size"), value_type=int
                ),
                "max_bag_duration": ParameterValue(
                    LaunchConfiguration("max_bag_duration"), value_type=float
                ),
                "keep_files": ParameterValue(LaunchConfiguration("keep_files"), value_type=int),
                "snapshot_mode": ParameterValue(
                    LaunchConfiguration("snapshot_mode"), value_type=bool
                ),
                "snapshot_s": ParameterValue(LaunchConfiguration("snapshot_s"), value_type=float),
                "snapshot_cycles": ParameterValue(
                    LaunchConfiguration("snapshot_cycles"), value_type=int
                ),
                "use_sim_time": ParameterValue(
                    LaunchConfiguration("use_sim_time"), value_type=bool
                ),
                "autostart": ParameterValue(LaunchConfiguration("autostart"), value_type=bool),
            },
        ],
        arguments=["--ros-args", "--log-level", LaunchConfiguration("log_level")],
        output="screen",
    )
