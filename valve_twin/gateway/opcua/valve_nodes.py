# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What a device shows of its valve: the same plain values as the JSON of the pages."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime, timedelta, timezone
from typing import TYPE_CHECKING, Any

from asyncua import ua

from valve_twin import __version__
from valve_twin.core.faults.ne107 import Ne107
from valve_twin.gateway.opcua.devices import HEALTH, NAMEPLATE, plate_value
from valve_twin.gateway.opcua.nodes import Ids
from valve_twin.gateway.opcua.units import engineering_unit

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from valve_twin.gateway.opcua.devices import DeviceModel
    from valve_twin.gateway.opcua.nodes import Builder

_V = ua.VariantType

VALUES = {
    "Verdict": ("verdict", _V.String, "Word of the aging monitor"),
    "Evidence": ("evidence", _V.String, "Why, in one line"),
    "Action": ("action", _V.String, "What is to be done, and how soon"),
    "FailureMode": ("failure_mode", _V.String, "Code of ISO 14224"),
    "State": ("ne107", _V.String, "State of NAMUR NE 107"),
    "WorstParameter": ("parameter", _V.String, "Parameter of the worst trend"),
    "Drift": ("drift", _V.Double, "Its change against the valve's own reference [%]"),
    "DriftLower95": ("drift_lower_95", _V.Double, "Lower end of its 95 % interval [%]"),
    "DriftUpper95": ("drift_upper_95", _V.Double, "Upper end of its 95 % interval [%]"),
    "WayToLimit": ("way", _V.Double, "Share of the way to the limit surely covered [1]"),
    "RemainingLife": ("remaining", _V.Double, "Median [RemainingLifeUnit]"),
    "RemainingLifeUnit": ("axis", _V.String, "What aging is counted in"),
    "ServiceDate": ("service_date_ns", _V.DateTime, "When the limit is reached"),
    "LimitState": ("limit_state", _V.String, "Worst parameter: within, warning or alarm"),
    "Residual": ("residual", _V.Double, "One-step residual of the newest cycles, RMS [1]"),
    "Confidence": ("confidence", _V.Double, "Share of the newest estimates trusted [1]"),
    "Cycle": ("cycle", _V.Int64, "Number of the last stored cycle"),
    "CycleEnd": ("end_ns", _V.DateTime, "Its last stamp on the data's clock"),
    "Cycles": ("cycles", _V.Int64, "Production cycles counted"),
    "Movements": ("movements", _V.Int64, "Movements in one direction beyond the noise"),
    "Reversals": ("reversals", _V.Int64, "Changes of direction"),
    "Starts": ("starts", _V.Int64, "Movements out of a rest"),
    "Travel": ("travel", _V.Double, "Way of the position [its unit]"),
    "Strokes": ("strokes", _V.Double, "Travel by the stroke [1]"),
    "Hours": ("hours", _V.Double, "Time in cycles [h]"),
    "HoursOpen": ("hours_open", _V.Double, "Time open [h]"),
    "HoursClosed": ("hours_closed", _V.Double, "Time closed [h]"),
    "HoursNearClosed": ("hours_near_closed", _V.Double, "Open by less than a tenth [h]"),
    "StrokeTest": ("stroke_test", _V.String, "Last stroke test: pass or fail, empty = none"),
    "StrokeTestTime": ("stroke_test_ns", _V.DateTime, "When it began"),
    "StrokeTestDaysSince": ("stroke_days_since", _V.Double, "Days since it [d]"),
    "StrokeTestDaysUntil": (
        "stroke_days_until",
        _V.Double,
        "Days until the next one, below 0 = overdue [d]",
    ),
    "OpenEvents": ("open_events", _V.Int64, "Entries of the event log nobody acknowledged"),
}
"""Key in the JSON, type and text of the variables of a device, by name."""

OF_PARAMETER = {
    "Lower95": ("lower_95", "Lower end of the 95 % interval"),
    "Upper95": ("upper_95", "Upper end of the 95 % interval"),
    "Reference": ("reference", "The valve's own level when it was new"),
    "Limit": ("threshold", "Service limit"),
    "Warning": ("warning", "Warning limit"),
    "Drift": ("drift", "Change against the reference [%]"),
    "DriftLower95": ("drift_lower_95", "Lower end of its 95 % interval [%]"),
    "DriftUpper95": ("drift_upper_95", "Upper end of its 95 % interval [%]"),
    "RemainingLow": ("remaining_low", "Remaining life, early end of its interval"),
    "Remaining": ("remaining", "Remaining life, median"),
    "RemainingHigh": ("remaining_high", "Remaining life, late end of its interval"),
}
"""Key in the JSON and text of the variables of a parameter, by name."""

OF_NAMEPLATE = {"Manufacturer": "maker", "SerialNumber": "serial", "ProductCode": "type"}
"""What is configured of the nameplate by the property of DI; tag and place are ours."""

_EPOCH = datetime(1970, 1, 1, tzinfo=timezone.utc)


@dataclass(frozen=True, slots=True)
class ValveNodes:
    """Nodes of one valve.

    Attributes
    ----------
    valve : str
        Its name as shown, which is the identifier of its device.
    index : int
        Namespace of the valves.
    model : DeviceModel
        Types of DI.
    """

    valve: str
    index: int
    model: DeviceModel

    @property
    def device(self) -> ua.NodeId:
        """Its device."""
        return ua.NodeId(self.valve, self.index)

    def node(self, *path: str) -> ua.NodeId:
        """Return the node of one of its variables."""
        return ua.NodeId("#".join((self.valve, *path)), self.index)

    def add(self, build: Builder, plain: Mapping[str, Any]) -> None:
        """Add the device with its nameplate, health and values.

        Parameters
        ----------
        build : Builder
            Takes the nodes.
        plain : mapping
            The valve as in the JSON.
        """
        name = ua.QualifiedName(self.valve, self.index)
        build.add_object(
            self.model.device_set, self.device, name, kind=self.model.device_type, events=True
        )
        given = plain["nameplate"]
        known = {"Model": plain["model"], "SoftwareRevision": f"valve_twin {__version__}"}
        known |= {name: given.get(key, "") for name, key in OF_NAMEPLATE.items()}
        for plate in NAMEPLATE:
            value = plate_value(plate, known.get(plate, ""))
            build.add_variable(self.device, self.node(plate), self.model.name(plate), value)
        build.add_variable(
            self.device,
            self.node("DeviceHealth"),
            self.model.name("DeviceHealth"),
            ua.Variant(0, _V.Int32),
            data=self.model.health_type,
            kind=Ids.BaseDataVariableType,
        )
        for key, (_, kind, text) in VALUES.items():
            self._variable(build, self.device, (key,), kind, text)
        for key in ("Tag", "Place"):
            text = ua.Variant(given.get(key.lower(), ""), _V.String)
            name = ua.QualifiedName(key, self.index)
            build.add_variable(self.device, self.node(key), name, text)
        group = self.node("ParameterSet")
        build.add_object(self.device, group, self.model.name("ParameterSet"))
        for parameter in plain["parameters"]:
            self._add_parameter(build, group, parameter)

    def _add_parameter(
        self, build: Builder, group: ua.NodeId, parameter: Mapping[str, Any]
    ) -> None:
        name = parameter["parameter"]
        node = build.add_variable(
            group,
            self.node("ParameterSet", name),
            ua.QualifiedName(name, self.index),
            ua.Variant(),
            data=ua.NodeId(Ids.Double),
            kind=Ids.AnalogItemType,
        )
        for key, value in (
            ("EURange", ua.Variant(_range(parameter))),
            ("EngineeringUnits", ua.Variant(engineering_unit(parameter["unit"]))),
        ):
            build.add_variable(
                node,
                self.node("ParameterSet", name, key),
                ua.QualifiedName(key),
                value,
                data=ua.NodeId(Ids.Range if key == "EURange" else Ids.EUInformation),
            )
        for key, (_, text) in OF_PARAMETER.items():
            self._variable(build, node, ("ParameterSet", name, key), _V.Double, text)

    def _variable(
        self,
        build: Builder,
        parent: ua.NodeId,
        path: tuple[str, ...],
        type_: ua.VariantType,
        text: str,
    ) -> None:
        name = ua.QualifiedName(path[-1], self.index)
        node = self.node(*path)
        data, kind = ua.NodeId(type_.value), Ids.BaseDataVariableType
        build.add_variable(parent, node, name, ua.Variant(), data=data, kind=kind, text=text)

    def values(self, plain: Mapping[str, Any]) -> Iterator[tuple[ua.NodeId, ua.Variant]]:
        """Yield node and value of everything that changes; None as value = not known.

        Parameters
        ----------
        plain : mapping
            The valve as in the JSON.
        """
        health = HEALTH[Ne107(plain["ne107"])]
        yield self.node("DeviceHealth"), ua.Variant(health, _V.Int32)
        for name, (key, kind, _) in VALUES.items():
            yield self.node(name), _variant(plain[key], kind)
        for parameter in plain["parameters"]:
            path = "ParameterSet", parameter["parameter"]
            yield self.node(*path), _variant(parameter["level"], _V.Double)
            yield self.node(*path, "EURange"), ua.Variant(_range(parameter))
            for name, (key, _) in OF_PARAMETER.items():
                yield self.node(*path, name), _variant(parameter[key], _V.Double)


def _variant(value: Any, kind: ua.VariantType) -> ua.Variant:  # noqa: ANN401  of JSON
    if kind is _V.DateTime:
        value = stamp(value)
    return ua.Variant() if value is None else ua.Variant(value, kind)


def stamp(stamp_ns: int) -> datetime | None:
    """Return a stamp [ns since 1970] as OPC UA knows it; None where there is none."""
    try:
        return _EPOCH + timedelta(microseconds=stamp_ns // 1000) if stamp_ns else None
    except OverflowError:
        return None


def _range(parameter: Mapping[str, Any]) -> ua.Range:
    """Return the range of normal operation: as far from the reference as the service limit.

    Without a limit it is the 95 % interval, without that nothing but the level.
    """
    reference, limit = parameter["reference"], parameter["threshold"]
    if reference is not None and limit is not None:
        way = abs(limit - reference)
        return ua.Range(Low=reference - way, High=reference + way)
    level = parameter["level"] or 0.0
    low, high = parameter["lower_95"], parameter["upper_95"]
    return ua.Range(Low=level if low is None else low, High=level if high is None else high)
