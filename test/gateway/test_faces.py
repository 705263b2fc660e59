# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The faces as node and `serve` open them: a history that takes long to be read delays none."""

from __future__ import annotations

import logging
import threading
import time

import pytest

pytest.importorskip("asyncua", reason="needs the extra gateway")
pytest.importorskip("foxglove", reason="needs the extra gateway")

from test.gateway.test_web import store
from valve_twin.gateway.faces import faces
from valve_twin.gateway.opcua.server import OpcUaFace
from valve_twin.gateway.plant import Plant
from valve_twin.io.config.gateway_parameters import FaceParameters

LIMIT_S = 60.0


@pytest.fixture
def slow_plant(tmp_path, monkeypatch):
    """A plant of two valves whose first reading goes on only when it may."""
    path, go_on, state = tmp_path / "history.sqlite", threading.Event(), Plant._state
    for valve in ("/a", "/b"):
        store(path, valve, range(1, 4), 0.0)

    def slow(plant: Plant, history, valve: str, mark):
        assert go_on.wait(LIMIT_S)
        return state(plant, history, valve, mark)

    monkeypatch.setattr(Plant, "_state", slow)
    yield Plant(f"sqlite:///{path}"), go_on
    go_on.set()


def until(found, what: str) -> None:
    end = time.monotonic() + LIMIT_S
    while not found():
        assert time.monotonic() < end, what
        time.sleep(0.01)  # polls


def test_no_face_waits_for_the_first_reading_and_each_shows_the_valves_after_it(
    slow_plant, tmp_path, monkeypatch
):
    plant, go_on = slow_plant
    shown: dict[str, OpcUaFace] = {}
    start = OpcUaFace.start

    def noted(face: OpcUaFace) -> str:
        shown["opcua"] = face
        return start(face)

    monkeypatch.setattr(OpcUaFace, "start", noted)
    given = FaceParameters(
        opcua="opc.tcp://127.0.0.1:0", opcua_pki=str(tmp_path), opcua_anonymous=True, foxglove=0
    )
    level = logging.getLogger("asyncua").level
    try:
        with faces(plant, given, lambda _: None) as foxglove:
            assert foxglove is not None
            assert not plant.news().whole  # open, and nothing is read
            assert set(foxglove._channels) == {"/diagnostics"}
            assert shown["opcua"]._valves == {}
            go_on.set()
            until(lambda: set(shown["opcua"]._valves) == {"/a", "/b"}, "OPC UA")
            until(lambda: "/b/twin/estimate" in foxglove._channels, "Foxglove")
    finally:
        logging.getLogger("asyncua").setLevel(level)
