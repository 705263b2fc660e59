# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What `ros2 run valve_twin NAME` starts."""

from __future__ import annotations

import gc
import os
import sys
import time
from contextlib import suppress
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import valve_twin.one_thread  # noqa: F401 - before numpy
from valve_twin.compat import interpreter, ros
from valve_twin.io.config.node_arguments import check_arguments
from valve_twin.io.errors import ConfigError
from valve_twin.nodes.runtime import termination
from valve_twin.nodes.runtime.transport import profile

_NODES = {
    "twin": ("twin", "TwinNode"),
    "simulated_valve": ("simulator", "SimulatedValveNode"),
    "aging_monitor": ("aging", "AgingMonitorNode"),
    "bag_player": ("player", "BagPlayerNode"),
    "bag_recorder": ("recorder", "BagRecorderNode"),
    "opcua_source": ("opcua_source", "OpcuaSourceNode"),
    "gateway": ("gateway", "GatewayNode"),
}
"""Room and class of each node."""

_NICENESS = {"gateway": 10}
"""Priority of who shows below that of who computes, so that no twin waits for a viewer [1]."""

_TRIES, _APART_S = 10, 0.11
"""To lower a session: of all users but root Linux takes one in 0.1 s [1], [s]."""

_ASKS_OFTEN = {"bag_player", "bag_recorder"}
"""Nodes of few topics that ask for what is missing a hundred times a second."""

_USAGE = 2

_COMPUTE = {"twin", "simulated_valve", "aging_monitor", "gateway"}
"""Nodes whose kernels come compiled from the installation."""


def twin() -> int:
    """Run the twin of one or more valves."""
    return run("twin")


def simulated_valve() -> int:
    """Run a simulated valve in place of the hardware."""
    return run("simulated_valve")


def aging_monitor() -> int:
    """Run the aging monitor of one or more valves."""
    return run("aging_monitor")


def bag_player() -> int:
    """Play a bag."""
    return run("bag_player")


def bag_recorder() -> int:
    """Record topics to a bag."""
    return run("bag_recorder")


def opcua_source() -> int:
    """Publish tags of a PLC."""
    return run("opcua_source")


def gateway() -> int:
    """Serve a history and its live twins in a browser."""
    return run("gateway")


def run(name: str) -> int:
    """Run a node by its name; the signals are taken before the slow imports begin."""
    if find_spec("rclpy") is None:
        sys.stderr.write(
            f"{name}: a node needs ROS 2, there is no rclpy here: source ROS 2, or use "
            "valve-twin, which works on bags and histories without\n"
        )
        return _USAGE
    termination.install()
    give_way(_NICENESS.get(name, 0))
    if not _accepts(name):
        return 1
    gc.disable()  # until the node has started: imports make hardly any garbage
    if name == "twin":
        interpreter.spare_imports()
    ros.load_types_alone()
    if name in _COMPUTE:
        interpreter.load_kernels_alone()
    _choose_transport(name)
    room, kind = _NODES[name]
    make = getattr(import_module(f"valve_twin.nodes.{room}.node"), kind)
    return int(import_module("valve_twin.nodes.runtime.node").run(make))


def _choose_transport(name: str) -> None:
    """Hear at once who is there; keep off shared memory where it may leave a node deaf."""
    ports = import_module("valve_twin.nodes.runtime.transport.dead_ports")  # not on Windows
    domain = ports.domain_id()
    ports.remove_unborn(domain)
    if name != "bag_player" and not ports.has_dead_port(domain):
        profile.announce_from_a_thread()
        return
    if name in _ASKS_OFTEN:
        profile.use_fast_heartbeat(over_udp=True)
    else:
        profile.keep_off_shared_memory()


def give_way(niceness: int) -> None:
    """Lower the priority of this process and, where it leads its session, of that.

    Linux shares processors among sessions first where it groups by them (its
    `sched_autogroup_enabled`): `nice` then counts only against what runs in the same one. A
    session that others lead is left as it is. Control groups with a share of the processors (of
    most containers, of services with a `CPUWeight`) go before sessions: there their share counts.
    """
    os.nice(niceness)
    if not niceness or os.getsid(0) != os.getpid():
        return
    with suppress(OSError):  # a kernel without such groups
        for _ in range(_TRIES):
            try:
                Path("/proc/self/autogroup").write_text(str(niceness), encoding="ascii")
            except BlockingIOError:
                time.sleep(_APART_S)
            else:
                break


def _accepts(name: str) -> bool:
    """Say in a line what is wrong with the parameter files; return whether the node may start."""
    try:
        warning = check_arguments(name, sys.argv[1:])
    except ConfigError as err:
        sys.stderr.write(f"{name}: cannot start: {err}\n")
        return False
    if warning:
        sys.stderr.write(f"{name}: {warning}\n")
    return True


if __name__ == "__main__":
    raise SystemExit(run(sys.argv.pop(1)))
