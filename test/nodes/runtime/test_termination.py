# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""SIGTERM and SIGINT end every installed executable at any moment, exit code 0 within 2 s."""

from __future__ import annotations

import os
import shutil
import signal
import statistics
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import pytest
from ament_index_python import get_package_prefix
from valve_twin_msgs.msg import Float64Stamped

from test.bag_samples import write_sample
from test.nodes.conftest import NS, CoreWait, has_ended, ready_s
from valve_twin.io.bags.writer import BagWriter
from valve_twin.nodes.recorder.node import BagRecorderNode

NAMES = ("twin", "simulated_valve", "aging_monitor", "bag_player", "bag_recorder")
NUMBERS = (signal.SIGTERM, signal.SIGINT)
LIMIT_S = 2.0
LEASE_S = 20.0  # of Fast DDS: so long a peer is kept that goes without a word
LATEST_S = 3.0
AT_ONCE = 3
SCRIPTS = Path(get_package_prefix("valve_twin")) / "lib" / "valve_twin"


@dataclass
class Case:
    """One start: the signal, when it is sent, and what came of it; times with a core free."""

    name: str
    number: signal.Signals
    after_s: float
    log: Path
    sent_s: float = 0.0
    code: int | None = None
    took_s: float = 0.0

    def __str__(self) -> str:
        said = self.log.read_text(errors="replace")[-600:]
        return (
            f"{self.name}: {self.number.name} {self.after_s:.2f} s after the start: exit "
            f"{self.code} after {self.took_s:.2f} s\n{said}"
        )

    @property
    def is_good(self) -> bool:
        said = self.log.read_text(errors="replace")
        return self.code == 0 and "Traceback" not in said


def script(name: str) -> str:
    """Return what `ros2 run valve_twin NAME` starts."""
    path = SCRIPTS / name
    return str(path) if path.exists() else str(shutil.which(name))


def parameters(name: str, folder: Path, label: str) -> list[str]:
    own = {
        "twin": [f"history_url:=sqlite:///{folder}/{label}.sqlite"],
        "simulated_valve": ["rate:=20.0"],
        "aging_monitor": [],
        "bag_player": [f"bag:={folder}/bag"],
        "bag_recorder": [f"bag:={folder}/{label}"],
    }[name]
    return [word for p in own for word in ("-p", p)]


def is_ours(pid: int) -> bool:
    """Whether both signals are put off or taken: in its first millisecond it is still `env`."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    masks = {line.split(":")[0]: line.split()[-1] for line in lines if line.startswith("Sig")}
    return all(
        (int(masks["SigBlk"], 16) | int(masks["SigCgt"], 16)) >> (n - 1) & 1 for n in NUMBERS
    )


def end_all(cases: list[Case], domain: int, folder: Path) -> None:
    """Start every case, a few at a time, and send its signal at its moment."""
    environment = {**os.environ, "ROS_DOMAIN_ID": str(domain)}
    waiting = list(cases)
    running: list[tuple[Case, subprocess.Popen[bytes], float]] = []
    while waiting or running:
        while waiting and len(running) < AT_ONCE:
            case = waiting.pop(0)
            command = [script(case.name), "--ros-args", "-r", f"__ns:=/{case.log.stem}"]
            command += parameters(case.name, folder, case.log.stem)
            with case.log.open("wb") as out:
                process = subprocess.Popen(command, env=environment, stdout=out, stderr=out)
            while not is_ours(process.pid):
                time.sleep(0.0005)
            running.append((case, process, time.monotonic()))
        for item in list(running):
            case, process, begin = item
            now, ready = time.monotonic(), ready_s(process.pid)
            if not case.sent_s and now - begin >= case.after_s:
                process.send_signal(case.number)
                case.sent_s = now - ready
            if has_ended(process.pid):
                case.took_s = time.monotonic() - ready_s(process.pid) - case.sent_s
                case.code = process.wait()
                running.remove(item)
            elif case.sent_s and now - ready - case.sent_s > 30.0 * LIMIT_S:
                process.kill()
        time.sleep(0.005)


def run(names, per_signal: int, graph, folder: Path) -> list[Case]:
    """Spread the moments over the first seconds, the first at once, for each signal."""
    with BagWriter(folder / "bag") as writer:
        for i in range(2000):
            write_sample(writer, "/press/v1/spool_position", 10**9 + i * 10**7, 0.5)
    cases = [
        Case(
            name,
            number,
            LATEST_S * (i + k / len(names)) / per_signal,
            folder / f"{name}_{number.name}_{i}.log",
        )
        for k, name in enumerate(names)
        for number in NUMBERS
        for i in range(per_signal)
    ]
    end_all(cases, graph.domain, folder)
    bad = [str(c) for c in cases if not c.is_good]
    assert len(cases) == per_signal * len(names) * len(NUMBERS)
    assert not bad, "\n\n".join(bad)
    return cases


def test_each_signal_ends_the_executables_twenty_times_and_within_two_seconds(graph, tmp_path):
    cases = run(NAMES, 4, graph, tmp_path)
    for name in NAMES:
        took = [c.took_s for c in cases if c.name == name]
        assert statistics.median(took) < LIMIT_S, f"{name}: {took}"


class Interrupted:
    """Is interrupted while a class is made that has it: what Python raises then is its affair."""

    def __set_name__(self, owner: type, name: str) -> None:
        raise KeyboardInterrupt


def test_an_import_that_is_broken_off_while_it_makes_a_class_is_no_error(graph, tmp_path, capfd):
    class Late(BagRecorderNode):
        def configure(self) -> None:
            type("Imported", (), {"descriptor": Interrupted()})

    node = graph.host(Late, start=False, bag=str(tmp_path / "recorded"))
    node.start()
    assert node.state == "configuring"
    node.stop()
    assert node.state == "configuring"  # cleaned up
    assert "Traceback" not in capfd.readouterr().err


STRUCK = """
import signal, time
from numba.core import codegen
from valve_twin.compat import interpreter
from valve_twin.core.valves.registry import get_simulation
from valve_twin.nodes.runtime import termination
from valve_twin.warmup import simulate_once
bind, bound = codegen.JITCPUCodegen.set_env, []
def strike(*arguments):
    if not bound:
        signal.raise_signal(signal.SIGTERM)
    bound.append(bind(*arguments))
codegen.JITCPUCodegen.set_env = strike
interpreter.load_kernels_alone()
termination.install()
termination.looping()
try:
    with termination.breaking_off():
        simulate_once(get_simulation("press_cartridge"))
        time.sleep(60.0)
except KeyboardInterrupt:
    print(f"broken off, {len(bound)} bound")
"""


def test_a_signal_while_a_compiled_kernel_is_loaded_breaks_off_behind_it():
    """In 1 of 150 starts the process crashed: the loader, called back, had no code to bind."""
    command = [sys.executable, "-X", "faulthandler", "-c", STRUCK]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert (ended.returncode, ended.stderr) == (0, "")
    assert ended.stdout.startswith("broken off, ")
    assert ended.stdout != "broken off, 0 bound\n"


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_each_signal_many_times_at_one_executable(graph, tmp_path, name):
    run((name,), 40, graph, tmp_path)


def test_a_node_that_ends_says_goodbye(graph, tmp_path):
    """Peers forget it at once, not when its lease ends after 20 s; a publisher waits for none."""
    publisher = graph.node.create_publisher(Float64Stamped, f"{NS}/spool_position", 10)
    process = graph.start("twin", history_url=f"sqlite:///{tmp_path}/history.sqlite")
    graph.spin_until(publisher.get_subscription_count, 120.0, "the twin's subscription")
    assert process.end() == 0
    begin_s, waited = time.monotonic(), CoreWait(os.getpid())
    graph.spin_until(lambda: not publisher.get_subscription_count(), what="its end to be known")
    assert time.monotonic() - begin_s - waited.so_far_s() < LEASE_S / 2
