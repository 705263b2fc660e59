# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Simulated valve, its twin and aging monitor, and a recorder; nothing real is moved.

The simulated valve works under /sim and the twin of the namespace listens there.
"""

from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.conditions import IfCondition
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription

PREFIX = "/sim"


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments, start the simulated valve and the recorder, include the rest."""
    autostart = ParameterValue(LaunchConfiguration("autostart"), value_type=bool)
    log_arguments = ["--ros-args", "--log-level", LaunchConfiguration("log_level")]
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
                "rate",
                default_value="1.0",
                description="Simulated seconds a second; 0 = as fast as the subscribers follow",
            ),
            DeclareLaunchArgument(
                "record",
                default_value="true",
                choices=["true", "false"],
                description="Record the topics of the valve",
            ),
            DeclareLaunchArgument(
                "bag",
                default_value="",
                description="Folder of the recorded bag; empty = valve_twin_DATE here",
            ),
            DeclareLaunchArgument(
                "use_sim_time",
                default_value="true",
                choices=["true", "false"],
                description="Take the time from the simulated valve's /clock",
            ),
            DeclareLaunchArgument(
                "clock",
                default_value=LaunchConfiguration("use_sim_time"),
                description="Publish /clock; false for all but one simulated valve of a domain",
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
            Node(
                package="valve_twin",
                executable="bag_recorder",
                name="bag_recorder",
                namespace=LaunchConfiguration("namespace"),
                condition=IfCondition(LaunchConfiguration("record")),
                parameters=[
                    {
                        "bag": ParameterValue(LaunchConfiguration("bag"), value_type=str),
                        "all": True,
                        "autostart": autostart,
                    }
                ],
                arguments=log_arguments,
                output="screen",
            ),
            Node(
                package="valve_twin",
                executable="simulated_valve",
                name="simulated_valve",
                namespace=LaunchConfiguration("namespace"),
                parameters=[
                    LaunchConfiguration("params_file"),
                    {
                        "publish_prefix": PREFIX,
                        "rate": ParameterValue(LaunchConfiguration("rate"), value_type=float),
                        "clock": ParameterValue(LaunchConfiguration("clock"), value_type=bool),
                        "autostart": autostart,
                    },
                ],
                arguments=log_arguments,
                output="screen",
            ),
        ]
    )
