# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the verbs do with mutated files: what differs from the sound file is told, by each verb."""

from __future__ import annotations

import io
import logging
from contextlib import redirect_stderr, redirect_stdout, suppress
from typing import TYPE_CHECKING

import numpy as np
import yaml

from test.bag_samples import write_sample
from test.io.foreign import INSTRUMENTS, START_NS, mutations, recording
from valve_twin.cli import main
from valve_twin.cli.output import shown
from valve_twin.io.bags.read import BagWriter, read_columns
from valve_twin.io.cdr.signals import SignalSource
from valve_twin.io.errors import IndexLiesError, ValveTwinError
from valve_twin.io.instruments.read import read_recording
from valve_twin.io.playback.player import bag_topics, compare_small, read_messages
from valve_twin.io.salvage.read import forget

if TYPE_CHECKING:
    from pathlib import Path

_VALVE = """/**:
  ros__parameters:
    model: first_order
    period_s: 0.01
    signals:
      command: {topic: command}
      position: {topic: position}
    cycles: {rule: window, window_s: 2.0}
"""
_SOURCES = [SignalSource(name, f"/valve/{name}") for name in ("command", "position")]


def said(*command: object) -> tuple[int, str]:
    """Run a verb; return its exit code and all that it said."""
    text = io.StringIO()
    forget()
    logger, handler = logging.getLogger("valve_twin"), logging.StreamHandler(text)
    logger.addHandler(handler)
    try:
        with redirect_stderr(text), redirect_stdout(text):
            code = main([str(part) for part in command])
    finally:
        logger.removeHandler(handler)
    return code, text.getvalue()


def of_bags(folder: Path, seed: int, count: int) -> list[str]:
    """Give mutated bags to the verbs; return a line for each that told too little.

    The bag stands under check sums, so that `info --verify` ends with 0 only where all messages
    are what they were; a verb that gives others than the sound bag names the file.
    """
    config, path = folder / "valve.yaml", folder / "a.mcap"
    config.write_text(_VALVE, encoding="utf-8")
    with BagWriter(folder / "made", chunk_size=1500) as writer:
        for i in range(60):
            write_sample(writer, "/valve/position", START_NS + i * 10_000_000, 0.25 * i)
            write_sample(writer, "/valve/command", START_NS + i * 10_000_000, -0.5 * i)
    data = (folder / "made" / "made_0.mcap").read_bytes()
    wrong = []
    sound: dict[str, object] = {}
    rng = np.random.default_rng(seed)
    for n, (how, changed) in enumerate([("sound", data), *mutations(data, rng, count)]):
        path.write_bytes(changed)
        outs = {verb: folder / f"{verb}_{n}" for verb in ("cut", "recover")}
        outs["convert"] = folder / f"convert_{n}.csv"
        verified, text = said("info", path, "--verify")
        if verified and str(path) not in text:
            wrong.append(f"seed {seed} case {n} ({how}): info --verify: {text}")
        for verb, out in outs.items():
            more = {
                "cut": ("--from", "0.0", "--to", "10.0"),
                "recover": (),
                "convert": ("--config", config),
            }[verb]
            code, text = said(verb, path, *more, "--out", out)
            found = None if code and not out.exists() else _content(out)
            known = sound.setdefault(verb, found)
            assert known is not None
            if found != known and (not verified or str(path) not in text):
                wrong.append(f"seed {seed} case {n} ({how}): {verb} {code}: {text}")
            if code not in (0, 1) or "Traceback" in text or "something unexpected" in text:
                wrong.append(f"seed {seed} case {n} ({how}): {verb} {code}: {text}")
    return wrong


def of_players(folder: Path, seed: int, count: int) -> list[str]:
    """Read mutated bags as `replay` does; return a line for each that gives others in silence.

    What is played is what the sound bag gives, or the file is named.
    """
    path = folder / "a.mcap"
    with BagWriter(folder / "made", chunk_size=1500) as writer:
        for i in range(60):
            write_sample(writer, "/valve/position", START_NS + i * 10_000_000, 0.25 * i)
            write_sample(writer, "/valve/command", START_NS + i * 10_000_000, -0.5 * i)
    data = (folder / "made" / "made_0.mcap").read_bytes()
    text = io.StringIO()
    logger, handler = logging.getLogger("valve_twin"), logging.StreamHandler(text)
    logger.addHandler(handler)
    wrong, sound = list[str](), object()
    rng = np.random.default_rng(seed)
    try:
        for n, (how, changed) in enumerate([("sound", data), *mutations(data, rng, count)]):
            path.write_bytes(changed)
            forget()
            text.truncate(0)
            try:
                found = _played(path)
            except ValveTwinError as err:
                found = str(err)
                text.write(found)
            sound = found if n == 0 else sound
            if found != sound and str(path) not in text.getvalue():
                wrong.append(f"seed {seed} case {n} ({how}): {text.getvalue()}")
    finally:
        logger.removeHandler(handler)
    return wrong


def _played(path: Path) -> object:
    """Return topics and messages; where times of an index lie the player asks once more."""
    for _ in range(2):
        with suppress(IndexLiesError):
            compare_small(path)
            topics = bag_topics(path)
            return topics, list(read_messages(path, [topic.name for topic in topics]))
    raise AssertionError


def _content(out: Path) -> object:
    if out.is_file():
        return out.read_bytes()
    return [(c.stamp_ns.tobytes(), c.values.tobytes()) for c in read_columns(out, _SOURCES)]


def of_configure(kind: str, folder: Path, seed: int, count: int) -> list[str]:
    """Let `configure` propose for mutated files; return a line for each that told too little.

    What cannot be read is refused with its name; each notice of the reader is said; a proposal is
    YAML whose columns are channels of the file.
    """
    subject = recording(kind, INSTRUMENTS[kind], folder)
    path = folder / subject.name
    wrong = []
    rng = np.random.default_rng(seed)
    for n, (how, data) in enumerate(mutations(subject.data, rng, count)):
        path.write_bytes(data)
        text, proposed = io.StringIO(), io.StringIO()
        with redirect_stderr(text), redirect_stdout(proposed):
            code = main(["configure", str(path), "--yes"])
        try:
            found = read_recording(path)
        except ValveTwinError:
            found = None
        lines = text.getvalue()
        if code or found is None:
            fine = code in (1, 2) and str(path) in lines and "something unexpected" not in lines
        else:
            names = {c.name for c in found.columns}
            values = yaml.safe_load(proposed.getvalue())["/**"]["ros__parameters"]
            asked = {s["column"] for s in values["signals"].values() if s.get("column")}
            told = " ".join(lines.split())
            fine = asked <= names
            fine &= all(shown(" ".join(notice.split())) in told for notice in found.notices)
        if not fine:
            wrong.append(f"{kind} seed {seed} case {n} ({how}): {code}: {lines[-400:]}")
    return wrong
