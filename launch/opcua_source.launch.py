# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Tags of a PLC on topics below /plc, for a twin with topic_prefix:=/plc."""

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments and start the source."""
    return LaunchDescription([*_arguments(), _source()])


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
                [FindPackageShare("valve_twin"), "config", "opcua_source.yaml"]
            ),
            description="YAML file with the tags and further parameters",
        ),
        DeclareLaunchArgument(
            "address",
            default_value="opc.tcp://127.0.0.1:4840",
            description="OPC UA server of the PLC",
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


def _source() -> Node:
    return Node(
        package="valve_twin",
        executable="opcua_source",
        name="opcua_source",
        namespace=LaunchConfiguration("namespace"),
        parameters=[
            {"address": ParameterValue(LaunchConfiguration("address"), value_type=str)},
            LaunchConfiguration("params_file"),  # an address there is the one that holds
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
