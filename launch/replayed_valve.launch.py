# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A recorded valve once more: its bag under /replay, its twin and aging monitor.

Nothing real is moved; the twin of the namespace listens under /replay.
"""

from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription

PREFIX = "/replay"


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments, start the player, include the rest."""
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "bag",
                default_value="",
                description="Folder of the bag",
            ),
            DeclareLaunchArgument(
                "namespace",
                default_value="/press/valve_1",
                description="Namespace of the nodes, which names the valve",
            ),
            DeclareLaunchArgument(
                "params_file",
                default_value=PathJoinSubstitution(
                    [FindPackageShare("valve_twin"), "config", "press_cartridge.yaml"]
                ),
                description="YAML file with the configuration of the valve and its nodes",
            ),
            DeclareLaunchArgument(
                "regex",
                default_value="",
                description="Play topics in whose name this expression is found; empty = all",
            ),
            DeclareLaunchArgument(
                "rate",
                default_value="1.0",
                description="Bag seconds a second; 0 = as fast as the subscribers follow",
            ),
            DeclareLaunchArgument(
                "start_offset_s",
                default_value="0.0",
                description="Begin this long after the first message [s]",
            ),
            DeclareLaunchArgument(
                "duration_s",
                default_value="0.0",
                description="Bag time to play [s]; 0 = to the end",
            ),
            DeclareLaunchArgument(
                "loop",
                default_value="false",
                choices=["true", "false"],
                description="Begin again at the end",
            ),
            DeclareLaunchArgument(
                "start_paused",
                default_value="false",
                choices=["true", "false"],
                description="Wait for the service resume",
            ),
            DeclareLaunchArgument(
                "use_sim_time",
                default_value="true",
                choices=["true", "false"],
                description="Take the time from the player's /clock",
            ),
            DeclareLaunchArgument(
                "clock",
                default_value=LaunchConfiguration("use_sim_time"),
                description="Publish /clock; false where another node of the domain does",
            ),
            DeclareLaunchArgument(
                "autostart",
                default_value="true",
                choices=["true", "false"],
                description="Configure and activate the nodes by themselves",
            ),
            DeclareLaunchArgument(
                "log_level",
                default_value="info",
                choices=["debug", "info", "warn", "error", "fatal"],
                description="Least severity that the nodes log",
            ),
            IncludeLaunchDescription(
                PythonLaunchDescriptionSource(
                    PathJoinSubstitution(
                        [FindPackageShare("valve_twin"), "launch", "one_valve.launch.py"]
                    )
                ),
                launch_arguments={
                    "namespace": LaunchConfiguration("namespace"),
                    "params_file": LaunchConfiguration("params_file"),
                    "topic_prefix": PREFIX,
                    "use_sim_time": LaunchConfiguration("use_sim_time"),
                    "autostart": LaunchConfiguration("autostart"),
                    "log_level": LaunchConfiguration("log_level"),
                }.items(),
            ),
            player(),
        ]
    )


def player() -> Node:
    """Return the player; what the launch says goes before what the file says."""
    return Node(
        package="valve_twin",
        executable="bag_player",
        name="bag_player",
        namespace=LaunchConfiguration("namespace"),
        parameters=[
            LaunchConfiguration("params_file"),
            {
                "publish_prefix": PREFIX,
                "bag": ParameterValue(LaunchConfiguration("bag"), value_type=str),
                "regex": ParameterValue(LaunchConfiguration("regex"), value_type=str),
                "rate": ParameterValue(LaunchConfiguration("rate"), value_type=float),
                "start_offset_s": ParameterValue(
                    LaunchConfiguration("start_offset_s"), value_type=float
                ),
                "duration_s": ParameterValue(LaunchConfiguration("duration_s"), value_type=float),
                "loop": ParameterValue(LaunchConfiguration("loop"), value_type=bool),
                "start_paused": ParameterValue(
                    LaunchConfiguration("start_paused"), value_type=bool
                ),
                "autostart": ParameterValue(LaunchConfiguration("autostart"), value_type=bool),
                "clock": ParameterValue(LaunchConfiguration("clock"), value_type=bool),
            },
        ],
        arguments=["--ros-args", "--log-level", LaunchConfiguration("log_level")],
        output="screen",
    )
