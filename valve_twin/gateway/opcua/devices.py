# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The part of the Devices model (DI, OPC 10000-100) that a valve needs, by its own node ids.

No wheel carries the nodeset, so the types are built here with the names and numbers of the
standard: a client that knows DI finds DeviceSet, DeviceType, DeviceHealth and ParameterSet where
they belong. The rest of DI is not there (`IsNamespaceSubset` says so): no topology, no locks, no
transfer, no software update, and of the alarms (`alarms`) no methods.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from asyncua import ua

from valve_twin.core.faults.ne107 import Ne107
from valve_twin.gateway.opcua.nodes import Ids

if TYPE_CHECKING:
    from valve_twin.gateway.opcua.nodes import Builder

URI = "http://opcfoundation.org/UA/DI/"

HEALTH = {
    Ne107.GOOD: 0,
    Ne107.FAILURE: 1,
    Ne107.CHECK_FUNCTION: 2,
    Ne107.OUT_OF_SPECIFICATION: 3,
    Ne107.MAINTENANCE_REQUIRED: 4,
}
"""DeviceHealthEnumeration by the state of NE 107."""

ALARMS = {
    Ne107.FAILURE: ("FailureAlarmType", 15292),
    Ne107.CHECK_FUNCTION: ("CheckFunctionAlarmType", 15441),
    Ne107.OUT_OF_SPECIFICATION: ("OffSpecAlarmType", 15590),
    Ne107.MAINTENANCE_REQUIRED: ("MaintenanceRequiredAlarmType", 15739),
}
"""Types of alarms by the state of NE 107, with their numbers in DI."""

_HEALTH_ALARM = 15143
_HEALTH_NAMES = ("NORMAL", "FAILURE", "CHECK_FUNCTION", "OFF_SPEC", "MAINTENANCE_REQUIRED")

_TOPOLOGY_ELEMENT, _DEVICE, _FUNCTIONAL_GROUP, _COMPONENT = 1001, 1002, 1005, 15063
_DEVICE_SET, _HEALTH_TYPE, _HEALTH_STRINGS = 5001, 6244, 6450
_META, _META_URI, _META_VERSION, _META_SUBSET = 15001, 15002, 15003, 15005

NAMEPLATE = {
    "Manufacturer": 6003,
    "ManufacturerUri": 15100,
    "Model": 6004,
    "ProductCode": 15101,
    "HardwareRevision": 6008,
    "SoftwareRevision": 6007,
    "DeviceRevision": 6006,
    "DeviceManual": 6005,
    "DeviceClass": 6470,
    "SerialNumber": 6001,
    "ProductInstanceUri": 15102,
    "RevisionCounter": 6002,
}
"""Properties of DeviceType by name, with their numbers there."""

_TEXTS = ("Manufacturer", "Model")


@dataclass(frozen=True, slots=True)
class DeviceModel:
    """Where the types of DI stand in an address space.

    Attributes
    ----------
    index : int
        Of the namespace.
    """

    index: int

    def name(self, text: str) -> ua.QualifiedName:
        """Return a name of the standard."""
        return ua.QualifiedName(text, self.index)

    def node(self, number: int) -> ua.NodeId:
        """Return a node of the standard."""
        return ua.NodeId(number, self.index)

    @property
    def device_set(self) -> ua.NodeId:
        """Where a client looks for devices."""
        return self.node(_DEVICE_SET)

    @property
    def device_type(self) -> ua.NodeId:
        """Type of a device."""
        return self.node(_DEVICE)

    @property
    def group_type(self) -> ua.NodeId:
        """Type of a group of its parameters."""
        return self.node(_FUNCTIONAL_GROUP)

    @property
    def health_type(self) -> ua.NodeId:
        """Type of its health."""
        return self.node(_HEALTH_TYPE)

    def add_types(self, build: Builder) -> None:
        """Add types, DeviceSet and what the namespace says of itself."""
        element = build.add_type(
            ua.NodeId(Ids.BaseObjectType),
            self.node(_TOPOLOGY_ELEMENT),
            self.name("TopologyElementType"),
            abstract=True,
        )
        component = build.add_type(
            element, self.node(_COMPONENT), self.name("ComponentType"), abstract=True
        )
        device = build.add_type(component, self.device_type, self.name("DeviceType"))
        build.add_type(
            ua.NodeId(Ids.FolderType), self.group_type, self.name("FunctionalGroupType")
        )
        for name, number in NAMEPLATE.items():
            build.add_variable(device, self.node(number), self.name(name), plate_value(name, ""))
        health = build.add_type(
            ua.NodeId(Ids.Enumeration),
            self.health_type,
            self.name("DeviceHealthEnumeration"),
            data=True,
        )
        texts = [ua.LocalizedText(text) for text in _HEALTH_NAMES]
        build.add_variable(
            health,
            self.node(_HEALTH_STRINGS),
            ua.QualifiedName("EnumStrings"),
            ua.Variant(texts, ua.VariantType.LocalizedText),
        )
        kind = ua.NodeId(Ids.InstrumentDiagnosticAlarmType)
        name = self.name("DeviceHealthDiagnosticAlarmType")
        alarm = build.add_type(kind, self.node(_HEALTH_ALARM), name)
        for text, number in ALARMS.values():
            build.add_type(alarm, self.node(number), self.name(text))
        build.add_object(ua.NodeId(Ids.ObjectsFolder), self.device_set, self.name("DeviceSet"))
        self._add_metadata(build)

    def _add_metadata(self, build: Builder) -> None:
        about = build.add_object(
            ua.NodeId(Ids.Server_Namespaces),
            self.node(_META),
            self.name(URI),
            kind=ua.NodeId(Ids.NamespaceMetadataType),
        )
        for number, name, value in (
            (_META_URI, "NamespaceUri", ua.Variant(URI)),
            (_META_VERSION, "NamespaceVersion", ua.Variant("1.04")),
            (_META_SUBSET, "IsNamespaceSubset", ua.Variant(True)),
        ):
            build.add_variable(about, self.node(number), ua.QualifiedName(name), value)


def plate_value(name: str, text: str) -> ua.Variant:
    """Return the value of a property of the nameplate; what is not known is empty, or -1.

    Parameters
    ----------
    name : str
        Of the property, see `NAMEPLATE`.
    text : str
        What is known.
    """
    if name == "RevisionCounter":
        return ua.Variant(-1, ua.VariantType.Int32)
    if name in _TEXTS:
        return ua.Variant(ua.LocalizedText(text))
    return ua.Variant(text, ua.VariantType.String)
