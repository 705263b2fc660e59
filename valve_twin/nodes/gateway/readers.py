# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Nodes that only hold subscriptions, and a participant of their own for those of moving plots.

Fast DDS asks every reader of a participant whether a message is its own where more than one
participant takes the topic, and locks each for it: beside the state topics of 50 valves a
prediction would cost twice as much to receive.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import rclpy
from rclpy.context import Context
from rclpy.node import Node

if TYPE_CHECKING:
    from valve_twin.nodes.runtime.node import ValveNode


def own_context(context: Context) -> Context:
    """Return another context, thus another participant, in the same domain and enclave."""
    made = Context()
    rclpy.init(context=made, domain_id=context.get_domain_id())
    return made


def make_reader(owner: ValveNode, name: str, context: Context) -> Node:
    """Return a node that no executor drives and that has nothing but what is made of it.

    Parameters
    ----------
    owner : ValveNode
        Whose namespace it stands in.
    name : str
        Its name.
    context : Context
        Whose participant it uses.
    """
    return Node(
        name,
        context=context,
        cli_args=["--ros-args", "-p", "start_type_description_service:=false"],
        namespace=owner.get_namespace(),
        use_global_arguments=False,
        start_parameter_services=False,
        enable_rosout=False,
    )
