# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Valves in a browser, with the moving plots of the twins that run."""

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments and start the gateway."""
    return LaunchDescription([*_arguments(), _gateway()])


def _arguments() -> list[DeclareLaunchArgument]:
    return [
        DeclareLaunchArgument(
            "namespace",
            default_value="/press/valve_1",
            description="Namespace of the node, put before relative topics",
        ),
        DeclareLaunchArgument(
            "params_file",
            default_value=PathJoinSubstitution(
                [FindPackageShare("valve_twin"), "config", "press_cartridge.yaml"]
            ),
            description="YAML file of the valves, that of their twins",
        ),
        DeclareLaunchArgument(
            "port",
            default_value="8107",
            description="TCP port of the pages; 0 = any that is free",
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


def _gateway() -> Node:
    return Node(
        package="valve_twin",
        executable="gateway",
        name="gateway",
        namespace=LaunchConfiguration("namespace"),
        parameters=[
            {"port": ParameterValue(LaunchConfiguration("port"), value_type=int)},
            LaunchConfiguration("params_file"),  # a port there is the one that holds
            {
                "use_sim_time": ParameterValue(
                    LaunchConfiguration("use_sim_time"), value_type=bool
                ),
                "autostart": ParameterValue(LaunchConfiguration("autostart"), value_type=bool),
            },
        ],
        arguments=["--ros-args", "--log-level", LaunchConfiguration("log_level")],
        output="screen",
    )
