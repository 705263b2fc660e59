# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the verbs that estimate do with mutated bags, histories, pages and configurations.

A bag and a history stand under check sums: what comes out is what comes of the sound one, or the
file is named. A page that was changed in one byte is never "equal in every bit".
"""

from __future__ import annotations

import shutil
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from test.bag_samples import write_sample
from test.io.foreign import LONGEST_S, START_NS, mutations
from test.io.foreign_verbs import said
from test.peak import forget_peak, peak_mb
from valve_twin.io.bags.read import BagWriter
from valve_twin.io.config.valve import load_config
from valve_twin.io.history.store import History
from valve_twin.io.history.valves import names
from valve_twin.io.offline.run import run_bag
from valve_twin.report.provenance.page import read_page
from valve_twin.report.provenance.record import META

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

MOST_MB = 1000.0
_PERIOD_NS = 20_000_000
_VALVE = """/**:
  ros__parameters:
    model: first_order
    period_s: 0.02
    history_url: "sqlite:///%s"
    signals:
      command: {topic: command}
      position: {topic: position}
    cycles: {rule: window, window_s: 2.4}
    options: {estimators: [output_error, features]}
"""


class Place:
    """A folder with a sound bag, its configuration, history and page.

    Parameters
    ----------
    folder : path
        Empty.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.bag, self.config = folder / "a.mcap", folder / "valve.yaml"
        self.history, self.page = folder / "a.sqlite", folder / "page.html"
        self.config.write_text(_VALVE % self.history, encoding="utf-8")
        rng, position = np.random.default_rng(5), 0.0
        with BagWriter(folder / "made", chunk_size=20_000) as writer:
            for i in range(1680):
                command = (0.2, 0.8, 0.5, 0.1)[i // 30 % 4]
                position += 0.02 / 0.3 * (command - position)
                stamp = START_NS + i * _PERIOD_NS
                write_sample(writer, "/valve/command", stamp, command)
                noisy = position + 1e-3 * rng.standard_normal()
                write_sample(writer, "/valve/position", stamp, noisy)
        shutil.move(folder / "made" / "made_0.mcap", self.bag)
        shutil.rmtree(folder / "made")
        (config,) = load_config(self.config)
        record = run_bag(config, self.bag)
        with History(self.history) as store:
            for n, cycle in enumerate(record.cycles):
                store.store(config.name, cycle, [e for e in record.estimates if e.cycle == n + 1])

    def outs(self) -> set[Path]:
        """Return what stands in the folder beside what was put there."""
        own = {self.bag, self.config, self.history, self.page}
        return {p for p in self.folder.iterdir() if p not in own}


def of_bags(folder: Path, seed: int, count: int) -> list[str]:
    """Give mutated bags to predict, report and reference; return a line for each wrong answer."""
    place = Place(folder)
    table, page, stored = folder / "p.csv", folder / "r.html", folder / "f.json"
    given = place.bag, "--config", place.config, "--out"
    verbs: dict[str, tuple[tuple[object, ...], Path, Callable[[Path], object]]] = {
        "predict": (("predict", *given, table), table, Path.read_bytes),
        "report": (("report", *given, page), page, _parts),
        "reference": (("reference", "--bag", *given, stored), stored, _numbers),
    }
    return _held(place, place.bag, verbs, seed, count)


def of_histories(folder: Path, seed: int, count: int) -> list[str]:
    """Give mutated histories to report and verify; return a line for each wrong answer."""
    place = Place(folder)
    page = folder / "r.html"
    assert said("report", "--config", place.config, "--out", place.page)[0] == 0
    verbs: dict[str, tuple[tuple[object, ...], Path, Callable[[Path], object]]] = {
        "report": (("report", "--config", place.config, "--out", page), page, _parts),
        "verify": (("verify", place.page, "--url", place.history), place.page, _parts),
    }
    return _held(place, place.history, verbs, seed, count)


def of_pages(folder: Path, seed: int, count: int) -> list[str]:
    """Give mutated pages to verify; return a line for each that passes or is not told."""
    place = Place(folder)
    given = place.bag, "--config", place.config, "--out"
    assert said("report", *given, place.page)[0] == 0
    data, wrong = place.page.read_bytes(), []
    at = data.index(META.encode())  # half of the mutations in what the page was made from
    head = data[at : at + 4000]
    rng = np.random.default_rng(seed)
    changed = list(mutations(data, rng, count // 2))
    changed += [
        (how, data[:at] + part + data[at + 4000 :])
        for how, part in mutations(head, rng, count - count // 2)
    ]
    for n, (how, mutated) in enumerate([("sound", data), *changed]):
        place.page.write_bytes(mutated)
        begin = time.process_time()
        code, text = said("verify", place.page)
        same = mutated == data or "valve-twin: version: " in text  # another version is told
        fine = (code == 0) == same and _in_a_line(code, text)
        fine &= str(place.page) in text or str(place.bag) in text
        if not fine or place.outs() or time.process_time() - begin > LONGEST_S:
            wrong.append(f"page seed {seed} case {n} ({how}): {code}: {text[-300:]}")
    return wrong


def of_configurations(folder: Path, seed: int, count: int) -> list[str]:
    """Give mutated configurations to predict and report; a line for each that is not held.

    They may ask for something else; nothing but what was asked for may be written.
    """
    place = Place(folder)
    page, table = folder / "r.html", folder / "p.csv"
    data, wrong = place.config.read_bytes(), list[str]()
    for n, (how, mutated) in enumerate(_all(data, np.random.default_rng(seed), count)):
        place.config.write_bytes(mutated)
        for verb, out in (("report", page), ("predict", table)):
            begin = time.process_time()
            code, text = said(verb, place.bag, "--config", place.config, "--out", out)
            fine = _in_a_line(code, text) and (n > 0 or code == 0)
            fine &= not code or str(place.config) in text or str(place.bag) in text
            fine &= place.outs() <= {page, table} and time.process_time() - begin < LONGEST_S
            if not fine:
                wrong.append(f"configuration seed {seed} case {n} ({how}): {verb} {code}: {text}")
    return wrong


def of_archives(folder: Path, seed: int, count: int) -> list[str]:
    """Give an archive of mutated bags to batch; a line for each wrong answer."""
    place = Place(folder)
    archive, out = folder / "archive", folder / "out"
    archive.mkdir()
    data = place.bag.read_bytes()
    rng = np.random.default_rng(seed)
    kinds = ["sound"]
    (archive / "m_0.mcap").write_bytes(data)
    for n, (how, mutated) in enumerate(mutations(data, rng, count), start=1):
        (archive / f"m_{n}.mcap").write_bytes(mutated)
        kinds.append(how)
    code, text = said("batch", archive, "--config", place.config, "--out", out, "--jobs", 1)
    wrong = [] if _in_a_line(code, text) else [f"batch seed {seed}: {code}: {text}"]
    sound = (out / "m_0.mcap.jsonl").read_bytes()
    for n, how in enumerate(kinds):
        found = out / f"m_{n}.mcap.jsonl"
        lines = [line for line in text.splitlines() if f"m_{n}.mcap:" in line]
        if not lines and (not found.exists() or found.read_bytes() != sound):
            wrong.append(f"batch seed {seed} case {n} ({how}): nothing told")
    return wrong if place.outs() == {archive, out} else [*wrong, f"{place.outs()}"]


def _held(
    place: Place,
    path: Path,
    verbs: dict[str, tuple[tuple[object, ...], Path, Callable[[Path], object]]],
    seed: int,
    count: int,
) -> list[str]:
    """Return a line for each run of a verb that says less than it has to of a mutated file."""
    data, sound, wrong = path.read_bytes(), dict[str, object](), list[str]()
    rng = np.random.default_rng(seed)
    forget_peak()
    before_mb = peak_mb()
    for n, (how, mutated) in enumerate(_all(data, rng, count)):
        for verb, (command, out, content) in verbs.items():
            for left in place.folder.glob(f"{path.name}?*"):
                left.unlink()
            path.write_bytes(mutated)
            if out != place.page:
                out.unlink(missing_ok=True)
            names._told.clear()  # as in a process of its own
            begin = time.process_time()
            code, text = said(*command)
            named = str(path) in text
            found = content(out) if out.exists() else None
            known = sound.setdefault(verb, found)
            fine = _in_a_line(code, text) and (named or (code == 0 and found == known))
            fine &= time.process_time() - begin < LONGEST_S
            fine &= known is not None and (n > 0 or code == 0)
            if not fine:
                wrong.append(f"{path.name} seed {seed} case {n} ({how}): {verb} {code}: {text}")
    strange = {p.name for p in place.outs()} - {v[1].name for v in verbs.values()}
    strange = {name for name in strange if not name.startswith(path.name)}
    wrong += [f"{path.name} seed {seed}: {strange}"] if strange else []
    grown_mb = peak_mb() - before_mb
    return wrong if grown_mb < MOST_MB else [*wrong, f"{path.name}: {grown_mb} MB"]


def _all(data: bytes, rng: np.random.Generator, count: int) -> Iterator[tuple[str, bytes]]:
    yield "sound", data
    yield from mutations(data, rng, count)


def _in_a_line(code: int, text: str) -> bool:
    return code in (0, 1, 2) and "something unexpected" not in text and "Traceback" not in text


def _parts(page: Path) -> object:
    """Return what a page says it was made from."""
    return read_page(page).provenance.origin.parts


def _numbers(stored: Path) -> object:
    return stored.read_bytes().partition(b"\n")[2]
