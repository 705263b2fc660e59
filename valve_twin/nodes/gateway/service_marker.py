# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Marks and acknowledgements from the page: to the twin where it runs, else into the history."""

from __future__ import annotations

from concurrent.futures import Future
from concurrent.futures import TimeoutError as Late
from typing import TYPE_CHECKING, Any

from valve_twin_msgs import srv

from valve_twin.gateway.page.marking import HistoryMarker, Seen, Work, check_note
from valve_twin.io.errors import StoreError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from valve_twin.io.config.valve import ValveConfig
    from valve_twin.nodes.runtime.node import ValveNode

PATIENCE_S = 10.0
"""A twin that does not answer is waited for so long [s]."""


class ServiceMarker:
    """Calls the services of the twins; from any thread but the node's.

    Parameters
    ----------
    node : ValveNode
        Whose clients they are.
    configs : mapping
        The valves by name.
    """

    def __init__(self, node: ValveNode, configs: Mapping[str, ValveConfig]) -> None:
        self._node = node
        self._histories = {name: c.history_url for name, c in configs.items()}
        self._clients = {
            (name, kind): node.create_client(kind, f"{name}/twin/{service}")
            for name in configs
            for kind, service in (
                (srv.MarkMaintenance, "mark_maintenance"),
                (srv.AcknowledgeEvent, "acknowledge_event"),
            )
        }

    def destroy(self) -> None:
        """Take the clients down."""
        for client in self._clients.values():
            self._node.destroy_client(client)
        self._clients = {}

    def mark(self, work: Work) -> str:
        """Take down work from the next cycle on.

        Raises
        ------
        ConfigError, StoreError
            If it is not taken down.
        """
        check_note(work)
        request = srv.MarkMaintenance.Request(
            note=work.signed, new_reference=work.new_reference, cycle=0
        )
        told = self._call(work.valve, request, srv.MarkMaintenance)
        return told if told is not None else self._history(work.valve).mark(work)

    def acknowledge(self, seen: Seen) -> str:
        """Take down who has seen an entry.

        Raises
        ------
        ConfigError, StoreError
            If it is not taken down.
        """
        request = srv.AcknowledgeEvent.Request(id=seen.number, who=seen.who, note=seen.note)
        told = self._call(seen.valve, request, srv.AcknowledgeEvent)
        return told if told is not None else self._history(seen.valve).acknowledge(seen)

    def _history(self, valve: str) -> HistoryMarker:
        urls = set(self._histories.values())
        return HistoryMarker(self._histories.get(valve, next(iter(urls))))

    def _call(self, valve: str, request: Any, kind: Any) -> str | None:
        """Return what the twin says; None where there is none."""
        client = self._clients.get((valve, kind))
        if client is None or not client.service_is_ready():
            return None
        answer: Future[Any] = Future()

        def call() -> None:
            client.call_async(request).add_done_callback(
                lambda done: answer.set_result(done.result())
            )

        self._node.post(call)
        try:
            response = answer.result(PATIENCE_S)
        except Late as err:
            msg = f"{valve}: its twin has not answered for {PATIENCE_S:.0f} s: look at the events"
            raise StoreError(msg) from err
        if not response.success:
            raise StoreError(response.message)
        return str(response.message)
