# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A short demo: live nodes, table, report page, recorded bag, no process left behind."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import pytest

from test.nodes.conftest import own_domain, release_domain

pytestmark = pytest.mark.ros

CYCLES = 14

DEMO = """
import random, runpy, sys

domain = int(sys.argv.pop(1))
random.SystemRandom.randrange = lambda *_: domain
runpy.run_module("valve_twin.demo", run_name="__main__", alter_sys=True)
"""
"""Runs the demo, which takes a domain by chance, on one that no other test uses."""


@pytest.fixture(scope="module")
def demo_on_a_domain():
    domain = own_domain()
    yield [sys.executable, "-c", DEMO, str(domain)]
    release_domain(domain)


def members(session: int) -> list[int]:
    """Return the ids of the processes of a session."""
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            fields = path.read_text().rsplit(")", 1)[1].split()
            if int(fields[3]) == session and fields[0] != "Z":
                found.append(int(path.parent.name))
    return found


def left_behind(session: int) -> list[int]:
    """Return what stays of a session; what follows its parent is given the core for it."""
    end = time.monotonic() + 30.0
    while (found := members(session)) and time.monotonic() < end:
        time.sleep(0.02)
    return found


@pytest.fixture(scope="module")
def demo(demo_on_a_domain, tmp_path_factory):
    """Run it without measured data in a session of its own."""
    out = tmp_path_factory.mktemp("demo")
    command = [*demo_on_a_domain, "--cycles", str(CYCLES), "--rate", "60"]
    command += ["--out", str(out), "--data", str(out / "nothing")]
    opened = out / "opened.txt"
    environment = {**os.environ, "BROWSER": f"sh -c 'echo %s >> {opened}'"}
    with (out / "told.txt").open("w+", encoding="utf-8") as told:
        process = subprocess.Popen(
            command, stdout=told, stderr=subprocess.STDOUT, start_new_session=True, env=environment
        )
        try:
            code = process.wait(240)
            left = left_behind(process.pid)
        finally:
            for pid in members(process.pid):
                os.kill(pid, signal.SIGKILL)
    text = (out / "told.txt").read_text(encoding="utf-8")
    page = opened.read_text(encoding="utf-8") if opened.exists() else ""
    return SimpleNamespace(folder=out / "1", code=code, text=text, left=left, page=page)


def test_ctrl_c_ends_it_without_a_trace_and_says_where_to_look(demo_on_a_domain, tmp_path):
    process = subprocess.Popen(
        [*demo_on_a_domain, "--cycles", "500", "--rate", "60", "--out", str(tmp_path)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
        env={k: v for k, v in os.environ.items() if k not in {"DISPLAY", "BROWSER"}},
    )
    try:
        assert process.stdout is not None
        next(line for line in process.stdout if "cycle 10 of 500" in line)
        os.killpg(process.pid, signal.SIGINT)  # a terminal tells all of them
        text = process.communicate(timeout=120)[0]
        assert left_behind(process.pid) == []
    finally:
        for pid in members(process.pid):
            os.kill(pid, signal.SIGKILL)
    assert process.returncode == 130
    assert "Traceback" not in text
    assert "Exception" not in text
    assert "stopped; the logs are in" in text
    for word in ("report page: tools/run valve-twin report", "in a browser:", "in Foxglove:"):
        assert word in text
    assert (tmp_path / "1" / "press_bag" / "metadata.yaml").is_file()


STOPPED_AS_A_MESSAGE_IS_MADE = """
import os, signal, threading, time
import rclpy
from valve_twin_msgs.msg import Estimate
from valve_twin.demo import watch

made = Estimate.__init__

def init(self, **given):
    made(self, **given)
    if threading.current_thread() is threading.main_thread():
        os.kill(os.getpid(), signal.SIGINT)  # the code that makes the message runs in C++

def publish(context):
    publisher = node.create_publisher(Estimate, "/v/twin/estimate", watch._LATCHED)
    publisher.publish(Estimate(used_by_trend=True, names=["K"], values=[1.0]))

context = rclpy.Context()
rclpy.init(context=context)
node = rclpy.create_node("source", context=context)
thread = threading.Thread(target=publish, args=[context])
thread.start()
thread.join()
Estimate.__init__ = init
try:
    print("ended by itself", watch.watch("/v", 2, limit_s=60.0))
except KeyboardInterrupt:
    print("stopped by Ctrl-C")
"""


def test_ctrl_c_while_a_message_is_made_ends_the_table_as_any_other():
    domain = own_domain()
    try:
        ended = subprocess.run(
            [sys.executable, "-c", STOPPED_AS_A_MESSAGE_IS_MADE],
            capture_output=True,
            text=True,
            timeout=100,
            env={**os.environ, "ROS_DOMAIN_ID": str(domain)},
            check=False,
        )
    finally:
        release_domain(domain)
    assert "stopped by Ctrl-C" in ended.stdout, ended.stderr


def test_the_demo_ends_well_or_says_what_it_missed(demo):
    if "inside the interval" in demo.text:
        assert demo.code == 0, demo.text
    else:
        assert demo.code == 1
        assert "OUTSIDE the interval" in demo.text, demo.text


def test_the_table_shows_the_cycles(demo):
    assert f"{CYCLES} of {CYCLES} cycles" in demo.text
    assert "K_in" in demo.text
    assert "verdict: " in demo.text


def test_what_was_left_out_is_told(demo):
    assert "no measured data at" in demo.text


def test_page_bag_and_history_are_there(demo):
    page = (demo.folder / "press_report.html").read_text(encoding="utf-8")
    assert "/press/valve_1" in page
    assert (demo.folder / "press_bag" / "metadata.yaml").is_file()
    assert (demo.folder / "history.sqlite").is_file()
    for name in ("press_report.html", "press_bag", "history.sqlite"):
        assert str(demo.folder / name) in demo.text


def test_no_process_is_left(demo):
    assert demo.left == []


def test_no_node_complained(demo):
    for log in demo.folder.glob("*.log"):
        assert "Traceback" not in log.read_text(errors="replace"), log.name


def test_the_demo_opens_the_live_page_and_ends_by_saying_where_to_look(demo):
    pytest.importorskip("starlette", reason="needs the extra gateway")
    page = re.search(r"live page while it runs: (http://127\.0\.0\.1:\d+/valve/\S+)", demo.text)
    assert page, demo.text
    assert demo.page.strip() == page.group(1)
    end = demo.text[demo.text.rindex("report page:") :]
    for word in ("in a browser:", "in Foxglove:"):
        assert word in end
