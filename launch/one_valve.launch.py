# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Twin and aging monitor of one real valve; the valve is the namespace."""

from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from launch import LaunchContext, LaunchDescription


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments and start both nodes."""
    return LaunchDescription(
        [
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
                "topic_prefix",
                default_value="",
                description="Put before the topic of every signal: /replay for a replayed bag, "
                "/sim for a simulated valve; empty = as the file says",
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
                description="Configure and activate the nodes by themselves",
            ),
            DeclareLaunchArgument(
                "log_level",
                default_value="info",
                choices=["debug", "info", "warn", "error", "fatal"],
                description="Least severity that the nodes log",
            ),
            OpaqueFunction(function=start_nodes),
        ]
    )


def start_nodes(context: LaunchContext) -> list[Node]:
    """Return both nodes; only arguments that say something override the file."""
    overrides = {
        name: ParameterValue(LaunchConfiguration(name), value_type=bool)
        for name in ("use_sim_time", "autostart")
    }
    prefix = LaunchConfiguration("topic_prefix").perform(context)
    if prefix:
        overrides["topic_prefix"] = ParameterValue(prefix, value_type=str)
    return [
        Node(
            package="valve_twin",
            executable=name,
            name=name,
            namespace=LaunchConfiguration("namespace"),
            parameters=[LaunchConfiguration("params_file"), overrides],
            arguments=["--ros-args", "--log-level", LaunchConfiguration("log_level")],
            output="screen",
        )
        for name in ("twin", "aging_monitor")
    ]
