#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Draw what clients of OPC UA, MQTT and Foxglove see of a valve: tools/run python tools/faces.py.

A simulated valve that wears is stored, `valve-twin serve` serves it, and clients by others look:
asyncua browses, paho hears what amqtt hands on, websockets reads Foxglove's channels.
"""

from __future__ import annotations

import asyncio
import json
import re
import socket
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import yaml
from asyncua import Client as OpcUaClient
from asyncua import ua
from markupsafe import escape
from paho.mqtt.client import Client as MqttClient
from pysparkplug import DBirth, NBirth
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from valve_twin.io.config.valve import load_config
from valve_twin.io.history.store import History
from valve_twin.io.offline.run import run_bag
from valve_twin.io.offline.simulated_bag import write_simulated_bag

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from asyncua import Node

ROOT = Path(__file__).resolve().parents[1]
IMAGES, CONFIG = ROOT / "docs" / "images", ROOT / "config" / "simulated_press.yaml"
CYCLES, PATIENCE_S, LONGEST = 60, 120.0, 78
ROW, LEFT, STEP, VALUES, WIDTH = 17.0, 18.0, 20.0, 380.0, 960.0
STYLE = """<style>
svg { font: 12px ui-monospace, monospace; fill: #1b2026; } .soft { fill: #545d68; }
.head { font-weight: 600; } .value { fill: #0062a0; } .line { stroke: #d5dadf; }
</style>
<rect width="100%" height="100%" fill="#fff"/>"""

Row = tuple[int, str, str]
"""Depth, name, and what stands behind it."""


def draw(name: str, title: str, rows: Sequence[Row]) -> None:
    """Write a tree as a picture."""
    height = ROW * (len(rows) + 2.5)
    parts = [f'<text class="head" x="{LEFT}" y="{1.3 * ROW:g}">{escape(title)}</text>']
    for k, (depth, text, value) in enumerate(rows):
        y, x = ROW * (k + 2.7), LEFT + STEP * depth
        if depth:
            parts.append(f'<path class="line" d="M{x - 13:g} {y - 4:g}H{x - 4:g}"/>')
        style = "" if value else ' class="head"'
        parts.append(f'<text{style} x="{x:g}" y="{y:g}">{escape(text)}</text>')
        shown = value if len(value) <= LONGEST else f"{value[: LONGEST - 1]}…"
        parts.append(f'<text class="value" x="{VALUES}" y="{y:g}">{escape(shown)}</text>')
    size = f'viewBox="0 0 {WIDTH:g} {height:g}" width="{WIDTH:g}" height="{height:g}"'
    label = f'role="img" aria-label="{escape(title)}"'
    svg = f'<svg xmlns="http://www.w3.org/2000/svg" {size} {label}>\n{STYLE}\n'
    path = IMAGES / f"{name}.svg"
    path.write_text(svg + "\n".join(parts) + "\n</svg>\n", encoding="utf-8")
    print(f"{path} written")


def store(path: Path, bag: Path) -> None:
    """Store the cycles of a valve that wears."""
    (config,) = load_config(CONFIG)
    write_simulated_bag(config, bag, cycles=CYCLES, seed=1)
    record = run_bag(config, bag)
    with History(path) as history:
        for cycle in record.cycles:
            found = [e for e in record.estimates if e.cycle == cycle.cycle]
            history.store(config.name, cycle, found)


@contextmanager
def broker(folder: Path) -> Iterator[int]:
    """Run a broker of MQTT; yield its port."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    anonymous = {"amqtt.plugins.authentication.AnonymousAuthPlugin": {"allow_anonymous": True}}
    where = {"default": {"type": "tcp", "bind": f"127.0.0.1:{port}"}}
    config = folder / "broker.yaml"
    config.write_text(yaml.safe_dump({"listeners": where, "plugins": anonymous}))
    command = [sys.executable, "-m", "amqtt.scripts.broker_script", "-c", str(config)]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield port
    finally:
        process.kill()
        process.wait()


@contextmanager
def served(path: Path, folder: Path, mqtt: int) -> Iterator[dict[str, str]]:
    """Serve a history by all faces; yield the address of each by its scheme."""
    log = folder / "serve.log"
    command = [sys.executable, "-m", "valve_twin.cli", "serve", "--port", "0", "--anonymous"]
    command += ["--url", path.name, "--config", str(CONFIG), "--opcua", "opc.tcp://127.0.0.1:0"]
    command += ["--opcua-pki", str(folder / "pki"), "--foxglove", "0", "--mqtt-group", "steel"]
    command += ["--mqtt", f"mqtt://127.0.0.1:{mqtt}", "--mqtt-node", "hall_1"]
    command += ["--mqtt-state", str(folder / "mqtt.json")]
    with log.open("w") as stream:
        process = subprocess.Popen(command, stderr=stream, cwd=path.parent)
    try:
        end = time.monotonic() + PATIENCE_S
        while "http://" not in log.read_text():
            if process.poll() is not None or time.monotonic() > end:
                sys.exit(log.read_text())
            time.sleep(0.1)
        text = log.read_text()
        yield {s: re.findall(rf"{s}://[\d.:]+", text)[0] for s in ("opc.tcp", "ws")}
    finally:
        process.terminate()
        process.wait()


async def browsed(address: str) -> list[Row]:
    """Return the tree of devices as a client of OPC UA finds it."""
    rows: list[Row] = []

    async def look(node: Node, depth: int) -> None:
        name = await node.read_browse_name()
        value = ""
        if await node.read_node_class() == ua.NodeClass.Variable:
            data = await node.read_data_value(raise_on_bad_status=False)
            value = _text(data.Value.Value) if data.Value else ""
            value = value if data.StatusCode.is_good() else data.StatusCode.name
            value = value or '""'
        rows.append((depth, f"{name.NamespaceIndex}:{name.Name}", value))
        for k, child in enumerate(await node.get_children()):
            if name.Name == "ParameterSet" and k:
                other = await child.read_browse_name()
                rows.append((depth + 1, f"{other.NamespaceIndex}:{other.Name}", "... likewise"))
            else:
                await look(child, depth + 1)

    async with OpcUaClient(address) as client:
        di = await client.get_namespace_index("http://opcfoundation.org/UA/DI/")
        await look(await client.nodes.objects.get_child(f"{di}:DeviceSet"), 0)
    return rows


def _text(value: object) -> str:
    if isinstance(value, ua.LocalizedText):
        return value.Text or ""
    if isinstance(value, ua.Range):
        return f"{value.Low:.6g} .. {value.High:.6g}"
    if isinstance(value, ua.EUInformation):
        return f"{value.DisplayName.Text} (UNECE {value.UnitId})"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


@contextmanager
def listening(port: int) -> Iterator[dict[str, bytes]]:
    """Hear all of Sparkplug; yield the first message of each topic."""
    found: dict[str, bytes] = {}
    client, end = MqttClient(), time.monotonic() + PATIENCE_S
    client.on_connect = lambda made, *_: made.subscribe("spBv1.0/#", 1)
    client.on_message = lambda _c, _u, message: found.setdefault(message.topic, message.payload)
    while True:
        try:
            client.connect("127.0.0.1", port)
            break
        except OSError:  # the broker is yet to listen
            if time.monotonic() > end:
                raise
            time.sleep(0.1)
    client.loop_start()
    yield found
    client.loop_stop()


def births(found: dict[str, bytes]) -> list[Row]:
    """Return the births of node and device, metric by metric."""
    end = time.monotonic() + PATIENCE_S
    while not any("DBIRTH" in topic for topic in found) and time.monotonic() < end:
        time.sleep(0.1)
    rows: list[Row] = []
    for topic in sorted((t for t in found if "BIRTH" in t), key=lambda t: "DBIRTH" in t):
        birth = (NBirth if "NBIRTH" in topic else DBirth).decode(found[topic])
        rows.append((0, topic, ""))
        opened = ""
        for metric in birth.metrics:
            group, _, rest = str(metric.name).partition("/")
            name = rest.partition("/")[0] if group in {"parameters", "cycles"} else ""
            if "/" in rest and group in {"parameters", "cycles"}:
                opened = opened or name
                if name != opened:
                    likewise = 1, f"{group}/{name}/...", "... likewise"
                    rows += [likewise] if likewise not in rows else []
                    continue
            value = "null" if metric.value is None else _text(metric.value)
            rows.append((1, str(metric.name), f"{metric.datatype.name.lower():9} {value}"))
    return rows


def channels(address: str) -> list[Row]:
    """Return the channels that Foxglove is offered, with their types."""
    with connect(address, subprotocols=[Subprotocol("foxglove.sdk.v1")], max_size=None) as viewer:
        while (said := json.loads(viewer.recv(PATIENCE_S)))["op"] != "advertise":
            pass
    return [(0, c["topic"], f"{c['schemaName']}, {c['encoding']}")
            for c in sorted(said["channels"], key=lambda c: str(c["topic"]))]  # fmt: skip


def main() -> None:
    """Draw all."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        history = folder / "history.sqlite"
        store(history, folder / "bag")
        with (
            broker(folder) as port,
            listening(port) as found,
            served(history, folder, port) as where,
        ):
            tree = asyncio.run(browsed(where["opc.tcp"]))
            offered, born = channels(where["ws"]), births(found)
    draw("opcua", "Objects/DeviceSet, browsed by asyncua", tree)
    draw("mqtt", "Births of Sparkplug B, heard behind a broker by paho", born)
    draw("foxglove", "Channels that a client of Foxglove is offered", offered)


if __name__ == "__main__":
    main()
