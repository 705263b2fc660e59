# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Alarms of DI for the health of a device: events of conditions that go active and inactive.

An alarm of a valve that is shown for the first time begins then, one of a valve that is gone ends.
There are no methods: an alarm cannot be acknowledged here (the pages do), a client that comes
later reads `DeviceHealth` instead of asking for a refresh.
"""

from __future__ import annotations

from copy import copy
from typing import TYPE_CHECKING

from asyncua import ua

from valve_twin.gateway.opcua.devices import ALARMS

if TYPE_CHECKING:
    from asyncua import Server
    from asyncua.server.event_generator import EventGenerator

    from valve_twin.core.faults.ne107 import Ne107
    from valve_twin.gateway.opcua.valve_nodes import ValveNodes


async def tell_health(
    server: Server, valve: ValveNodes, before: Ne107, now: Ne107, text: str
) -> None:
    """Send the end of one alarm and the begin of another where the state is another one.

    Parameters
    ----------
    server : Server
        Who sends.
    valve : ValveNodes
        The device.
    before, now : Ne107
        Its states; good has no alarm.
    text : str
        What an alarm that begins says.
    """
    for state, begins in ((before, False), (now, True)):
        if before is now or state not in ALARMS:
            continue
        name, number = ALARMS[state]
        kind = ua.NodeId(number, valve.model.index)
        generator = await server.get_event_generator(kind, emitting_node=valve.device)
        word = "Active" if begins else "Inactive"
        values = {
            "NodeId": valve.node("DeviceHealthAlarms", name),  # ConditionId
            "ConditionName": name.removesuffix("Type"),
            "Severity": state.severity,
            "Retain": begins,
            "EnabledState": ua.LocalizedText("Enabled"),
            "EnabledState/Id": True,
            "ActiveState": ua.LocalizedText(word),
            "ActiveState/Id": begins,
            "AckedState": ua.LocalizedText("Acknowledged"),
            "AckedState/Id": True,  # nothing waits for it here
            "BranchId": ua.NodeId(),
            "Quality": ua.StatusCode(ua.StatusCodes.Good),
            "InputNode": valve.node("DeviceHealth"),
        }
        for field, value in values.items():
            setattr(generator.event, field, value)
        message = text if begins else f"{valve.valve}: {state.value} ended"
        await send(server, generator, message)


async def send(server: Server, generator: EventGenerator, message: str) -> None:
    """Send an event to who listens at its device, and to who listens at the server for all.

    Parameters
    ----------
    server : Server
        Who sends.
    generator : EventGenerator
        Of the device, with the event in it.
    message : str
        Its text.
    """
    await generator.trigger(message=message)
    event = copy(generator.event)
    event.emitting_node = server.nodes.server.nodeid
    await server.iserver.subscription_service.trigger_event(event)
