# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Nodes of an address space that nobody but the server itself can write, added in one go."""

from __future__ import annotations

from typing import TYPE_CHECKING

from asyncua import ua

if TYPE_CHECKING:
    from asyncua import Server

Ids = ua.ObjectIds


class Builder:
    """Adds nodes below others; every variable can be read only.

    Parameters
    ----------
    server : Server
        Whose address space it is.
    """

    def __init__(self, server: Server) -> None:
        self._session = server.iserver.isession
        self._items: list[ua.AddNodesItem] = []

    def add_object(
        self,
        parent: ua.NodeId,
        node: ua.NodeId,
        name: ua.QualifiedName,
        *,
        kind: ua.NodeId | None = None,
        events: bool = False,
    ) -> ua.NodeId:
        """Add an object.

        Parameters
        ----------
        parent, node : NodeId
            Below which, and its own.
        name : QualifiedName
            Its name when browsed.
        kind : NodeId, optional
            Its type, default the base of all objects.
        events : bool
            Whether a client may subscribe to its events.
        """
        attributes = ua.ObjectAttributes(
            DisplayName=ua.LocalizedText(name.Name), EventNotifier=ua.Byte(int(events))
        )
        kind = kind or ua.NodeId(Ids.BaseObjectType)
        return self._add(
            parent, node, name, ua.NodeClass.Object, attributes, kind, Ids.HasComponent
        )

    def add_type(
        self,
        parent: ua.NodeId,
        node: ua.NodeId,
        name: ua.QualifiedName,
        *,
        abstract: bool = False,
        data: bool = False,
    ) -> ua.NodeId:
        """Add a subtype of objects, or of data.

        Parameters
        ----------
        parent, node : NodeId
            The type that it refines, and its own.
        name : QualifiedName
            Its name when browsed.
        abstract : bool
            Whether nothing may be of this type itself.
        data : bool
            Whether it is a type of data.
        """
        make = ua.DataTypeAttributes if data else ua.ObjectTypeAttributes
        node_class = ua.NodeClass.DataType if data else ua.NodeClass.ObjectType
        attributes = make(DisplayName=ua.LocalizedText(name.Name), IsAbstract=abstract)
        return self._add(parent, node, name, node_class, attributes, ua.NodeId(), Ids.HasSubtype)

    def add_variable(
        self,
        parent: ua.NodeId,
        node: ua.NodeId,
        name: ua.QualifiedName,
        value: ua.Variant,
        *,
        data: ua.NodeId | None = None,
        kind: int = Ids.PropertyType,
        text: str = "",
    ) -> ua.NodeId:
        """Add a variable: a property unless another type is named.

        Parameters
        ----------
        parent, node : NodeId
            Below which, and its own.
        name : QualifiedName
            Its name when browsed.
        value : Variant
            What it shows first.
        data : NodeId, optional
            Type of its value, default that of the variant.
        kind : int
            Type of the variable.
        text : str
            Its description.
        """
        array = isinstance(value.Value, list)
        attributes = ua.VariableAttributes(
            DisplayName=ua.LocalizedText(name.Name),
            Description=ua.LocalizedText(text or name.Name),
            Value=value,
            DataType=data or ua.NodeId(value.VariantType.value),
            ValueRank=ua.Int32(ua.ValueRank.OneDimension if array else ua.ValueRank.Scalar),
            AccessLevel=ua.AccessLevel.CurrentRead.mask,
            UserAccessLevel=ua.AccessLevel.CurrentRead.mask,
        )
        by = Ids.HasProperty if kind == Ids.PropertyType else Ids.HasComponent
        return self._add(
            parent, node, name, ua.NodeClass.Variable, attributes, ua.NodeId(kind), by
        )

    def _add(
        self,
        parent: ua.NodeId,
        node: ua.NodeId,
        name: ua.QualifiedName,
        node_class: ua.NodeClass,
        attributes: object,
        kind: ua.NodeId,
        by: int,
    ) -> ua.NodeId:
        item = ua.AddNodesItem()
        item.ParentNodeId, item.RequestedNewNodeId = parent, node
        item.BrowseName, item.NodeClass = name, node_class
        item.NodeAttributes, item.TypeDefinition = attributes, kind
        item.ReferenceTypeId = ua.NodeId(by)
        self._items.append(item)
        return node

    async def build(self) -> None:
        """Add what was collected."""
        items, self._items = self._items, []
        for result in await self._session.add_nodes(items):
            result.StatusCode.check()
