# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Ports of shared memory whose process is dead, as the kernel shows them."""

import fcntl
import mmap
import os
import re
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest
from valve_twin_msgs.msg import Prediction

from test.nodes.conftest import NS
from test.nodes.feeding import REARM, Feeder
from valve_twin.nodes.runtime.transport import dead_ports
from valve_twin.nodes.runtime.transport.dead_ports import domain_id, has_dead_port, remove_unborn

PORT = 7400 + 250 * 3 + 11


@pytest.fixture(params=["fastrtps", "fastdds"], ids=["Jazzy", "Kilted"])
def name(request):
    return f"{request.param}_port{PORT}"


@pytest.fixture
def kernel(tmp_path, name):
    """Return the memory and a process that has one port of domain 3 open."""
    memory, process = tmp_path / "shm", tmp_path / "proc" / "41"
    memory.mkdir()
    process.mkdir(parents=True)
    (memory / f"{name}_el").touch()
    write_maps(process, f"/dev/shm/{name}")
    return memory, tmp_path / "proc"


def write_maps(process, *names, inode=7):
    files = ("/usr/lib/libc.so", *names)
    lines = [f"7f00-7f01 rw-s 00000000 00:1a {inode}   {name}" for name in files]
    (process / "maps").write_text("\n".join(lines) + "\n")


def test_a_port_that_nobody_holds_and_somebody_has_open_is_dead(kernel):
    assert has_dead_port(3, *kernel)
    assert not has_dead_port(2, *kernel)
    assert not has_dead_port(4, *kernel)


def test_a_port_that_is_held_is_alive(kernel, name):
    memory, _ = kernel
    with (memory / f"{name}_el").open("rb") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        assert not has_dead_port(3, *kernel)
    assert has_dead_port(3, *kernel)


def test_a_port_that_was_dead_is_kept_off_as_long_as_somebody_has_it_open(kernel, name):
    memory, processes = kernel
    assert has_dead_port(3, *kernel)
    with (memory / f"{name}_el").open("rb") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        assert has_dead_port(3, *kernel)
        assert not has_dead_port(2, *kernel)
        write_maps(processes / "41", f"/dev/shm/{name}", inode=8)  # made anew, and opened anew
        assert not has_dead_port(3, *kernel)
        write_maps(processes / "41", f"/dev/shm/{name}")
        (processes / "41").rename(processes / "42")
        assert not has_dead_port(3, *kernel)


def test_a_dead_port_that_nobody_has_open_harms_nobody(kernel):
    _, processes = kernel
    write_maps(processes / "41")
    assert not has_dead_port(3, *kernel)


def test_memory_that_was_made_anew_under_a_writer_is_dead(kernel, name):
    memory, processes = kernel
    with (memory / f"{name}_el").open("rb") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        write_maps(processes / "41", f"/dev/shm/{name} (deleted)")
        assert has_dead_port(3, *kernel)


def test_a_machine_that_shows_neither_has_none(tmp_path):
    assert not has_dead_port(3, tmp_path / "shm", tmp_path / "proc")


@pytest.mark.parametrize(("text", "domain"), [("17", 17), ("", 0), ("x", 0)])
def test_the_domain_is_that_of_the_environment(text, domain, monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", text)
    assert domain_id() == domain


def ports_of(node) -> set[str]:
    """Return the ports of shared memory that a node has open."""
    maps = Path(f"/proc/{node.pid}/maps").read_text()
    return set(re.findall(r"/dev/shm/fast\w+_port\d+$", maps, re.MULTILINE))


def uses_shared_memory(node) -> bool:
    return "/dev/shm/fast" in Path(f"/proc/{node.pid}/maps").read_text()


def keep_open(path: str) -> mmap.mmap:
    with Path(path).open("rb") as file:
        return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)


def test_twins_that_follow_a_killed_one_keep_off_its_memory_and_hear(graph, tmp_path):
    """The publisher goes on; it has the memory of the dead open, which nobody reads.

    Fast DDS lets go of it when the dead one's lease has ended, the test does not: a twin may take
    longer to start on a busy machine.
    """
    history = {"history_url": f"sqlite:///{tmp_path}/h.sqlite", **REARM}
    twin = graph.start("twin", **history)
    found = graph.record(f"{NS}/twin/prediction", Prediction)
    feeder = Feeder(graph, NS)
    graph.be_heard(f"{NS}/twin")
    feeder.feed(10)
    graph.spin_until(lambda: len(found) == 10, what="predictions")
    assert uses_shared_memory(twin)
    kept = [keep_open(port) for port in ports_of(twin)]
    assert kept
    for _ in range(2):
        os.kill(twin.pid, signal.SIGKILL)
        twin.process.wait()
        found.clear()
        twin = graph.start("twin", **history)
        graph.spin_until(lambda t=twin: "is active" in t.log, 60.0, "the next twin")
        assert not uses_shared_memory(twin)
        graph.be_heard(f"{NS}/twin")
        feeder.feed(10)
        graph.spin_until(lambda: len(found) >= 10, what="predictions of the next")
    for memory in kept:
        memory.close()


@pytest.mark.parametrize(
    ("content", "age_s", "port", "is_open", "is_there"),
    [
        (b"", 3.0, PORT, True, False),
        (b"", 0.5, PORT, True, True),
        (b"", 0.0, PORT, False, True),
        (b"", 0.5, PORT, False, False),
        (bytes(99), 3.0, PORT, True, False),
        (bytes(99), 0.5, PORT, True, True),
        (bytes(99), 0.5, PORT, False, False),
        (b"\1" + bytes(98), 0.5, PORT, False, False),
        (b"\2" + bytes(98), 3.0, PORT, False, True),
        (bytes(99), 3.0, PORT + 250, False, True),
    ],
    ids=[
        "unborn and waited for",
        "being made",
        "being made where nobody sees",
        "unborn",
        "unborn with a size and waited for",
        "being filled",
        "unborn with a size",
        "unborn while it was filled",
        "alive",
        "of another domain",
    ],
)
def test_a_port_whose_maker_was_killed_is_removed(
    tmp_path, content, age_s, port, is_open, is_there
):
    path, places = tmp_path / f"fastrtps_port{port}", tmp_path / "proc" / "41" / "fd"
    path.write_bytes(content)
    made_s = time.time() - age_s
    os.utime(path, (made_s, made_s))
    places.mkdir(parents=True)
    (places / "5").symlink_to(path if is_open else "/dev/null")
    (places / "6").symlink_to("socket:[7]")
    mutex = path.with_name(f"sem.{path.name}_mutex")  # left as it was by a killed one that waited
    mutex.touch()
    with path.open("rb") as waiting:
        remove_unborn(3, tmp_path, tmp_path / "proc")
        assert path.exists() == mutex.exists() == is_there
        assert waiting.read(4) == (content[:4] if is_there else b"\3\0\0\0")


def test_a_port_that_another_node_made_anew_meanwhile_is_left(tmp_path, monkeypatch):
    path = tmp_path / f"fastrtps_port{PORT}"
    path.write_bytes(bytes(99))
    made_s = time.time() - 0.5
    os.utime(path, (made_s, made_s))

    def slow(*_):
        path.unlink()
        path.write_bytes(b"\2" + bytes(98))
        return False

    monkeypatch.setattr(dead_ports, "_is_open", slow)
    remove_unborn(3, tmp_path, tmp_path)
    assert path.read_bytes()[:1] == b"\2"


STRANGER = "import rclpy; rclpy.init(); rclpy.create_node('n'); print('made', flush=True)"


def leave_unborn(domain):
    """Leave ports as makers do that were killed half a second ago: no word that they are ready."""
    first, made_s = 7400 + 250 * domain, time.time() - 0.5
    own = Path("/proc/self/maps").read_text()
    for name in ("fastrtps", "fastdds"):
        for port in range(first + 10, first + 40):
            path = Path(f"/dev/shm/{name}_port{port}")
            if f"{path}\n" not in own:
                for old in (path.name, f"{path.name}_el", f"sem.{path.name}_mutex"):
                    # of an earlier test in this domain; one whose lock is free is made anew
                    path.with_name(old).unlink(missing_ok=True)
                with path.open("xb") as file:
                    file.truncate(52400)
                os.utime(path, (made_s, made_s))


def test_a_node_starts_where_others_were_killed_while_they_made_their_ports(graph, tmp_path):
    """Restarted at once: what is not ready yet is no older than its maker's end."""
    leave_unborn(graph.domain)
    twin = graph.start("twin", history_url=f"sqlite:///{tmp_path}/h.sqlite", **REARM)
    graph.spin_until(lambda: "is active" in twin.log, 60.0, "the twin")


def stands_before_a_port(pid):
    """Whether a process has one open that is not ready."""
    for place in Path(f"/proc/{pid}/fd").iterdir():
        with suppress(OSError):  # it has just been closed
            path = place.readlink()
            if re.match(r"/dev/shm/fast\w+_port\d+$", str(path)):
                with path.open("rb") as file:
                    if file.read(4) == bytes(4):
                        return True
    return False


def test_who_stands_before_a_port_without_a_maker_is_let_go(graph):
    """A stranger stood there for ever, deaf to SIGTERM."""
    leave_unborn(graph.domain)
    environment = os.environ | {"ROS_DOMAIN_ID": str(graph.domain)}
    command = [sys.executable, "-c", STRANGER]
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE) as stranger:
        graph.spin_until(lambda: stands_before_a_port(stranger.pid), 60.0, "it to stand there")
        stranger.terminate()
        with pytest.raises(subprocess.TimeoutExpired):
            stranger.wait(2.5)
        remove_unborn(graph.domain)
        assert stranger.wait(60.0) is not None
