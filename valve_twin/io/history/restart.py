# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""How the twin of a valve goes on after a restart: from its snapshot, else after the last cycle.

The history tells what was learnt and which cycle is the last; the snapshot, where there is one,
what was under way. A stored cycle is never stored again: a snapshot is used only where the history
still ends with the cycle that it ended with then.
"""

from __future__ import annotations

import hashlib
import os
import time
from contextlib import suppress
from dataclasses import replace
from functools import cache, partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from valve_twin import __version__, core
from valve_twin.core.alignment import POSITION
from valve_twin.core.estimation.cycle.memory import MEMORY_CYCLES, memory_from_history
from valve_twin.core.rejoin import Rejoin
from valve_twin.core.state import Resume
from valve_twin.core.twin import EFFECT_DELAY, Event, Twin
from valve_twin.core.valves.registry import get_model, model_module
from valve_twin.io.errors import StoreError, unwritable
from valve_twin.io.history.snapshot import Origin, load_snapshot, save_snapshot
from valve_twin.io.sealed import flush

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from valve_twin.core.rejoin import Samples
    from valve_twin.core.state import TwinState
    from valve_twin.core.types import Cycle, Estimate
    from valve_twin.io.config.valve import ValveConfig
    from valve_twin.io.history.claim import Claim
    from valve_twin.io.history.store import History

REST = 10.0
"""A snapshot is followed by a rest of so many times what it took [1]."""


class Restart:
    """The begin of one valve's twin, and the snapshots for its next begin.

    Parameters
    ----------
    history : History
        Open for writing.
    config : ValveConfig
        The valve.
    claim : Claim
        On the valve's cycles; knows the last one that was announced, stored or not.
    make : callable
        Makes the twin of the valve of its `memory`, `last_cycle` and `resume`.
    tell : callable
        Gets one line on how the twin goes on.

    Attributes
    ----------
    twin : Twin
        The twin.
    last_cycle : int
        Number of the last stored cycle when it began [1], 0 = none.
    """

    def __init__(
        self,
        history: History,
        config: ValveConfig,
        claim: Claim,
        *,
        make: Callable[..., Twin],
        tell: Callable[[str], None],
    ) -> None:
        self._config, self._claim, self._tell = config, claim, tell
        self._path = history.snapshot_path(config.name)
        self._rejoin: Rejoin | None = None
        self._closed: Cycle | None = None
        self._held: Origin | None = None
        self._rests_until_s = 0.0
        last = history.last_record(config.name)
        self.last_cycle = last.cycle if last is not None else 0
        self._resume: Resume | None = None
        if last is not None:
            self._resume = Resume(last.start_ns, last.end_ns, claim.announced)
        elif claim.announced.number:
            self._resume = Resume(announced=claim.announced)
        digest, build = _digest(config), build_of(config.model)
        self._origin = Origin(__version__, config.name, digest, build=build)
        self.stored(self.last_cycle, last.start_ns if last is not None else 0)
        recent = partial(history.recent_estimates, config.name)
        self.twin = make(
            memory=memory_from_history(recent(MEMORY_CYCLES)),
            last_cycle=self.last_cycle,
            resume=self._resume,
        )
        self._restore(partial(recent, MEMORY_CYCLES + EFFECT_DELAY + 1))

    @property
    def is_open(self) -> bool:
        """Whether it is not known yet that the stream goes on where the snapshot ends."""
        return self._rejoin is not None

    def push(self, parts: Sequence[Samples]) -> list[Event]:
        """Take samples while it is open, as `Twin.push_round` after that."""
        assert self._rejoin is not None
        self._rejoin.add(parts)
        return self._settle() if self._rejoin.goes_on is not None else []

    def give_up(self) -> list[Event]:
        """Leave the running cycle of the snapshot out, if it is still open whether it goes on."""
        if self._rejoin is None:
            return []
        self._rejoin.give_up()
        return self._settle()

    def stored(self, number: int, start_ns: int) -> None:
        """Note the last cycle that is in the history or on its way there.

        Parameters
        ----------
        number : int
            Its number [1].
        start_ns : int
            Its first stamp [ns].
        """
        self._origin = replace(self._origin, cycle=number, start_ns=start_ns)

    def saving(self) -> Callable[[], None] | None:
        """Return what saves a snapshot of now, on any thread; None where there is nothing to save.

        For a time when all that was estimated is in the history. While it is open whether the
        stream goes on, the snapshot before holds until a cycle that waited in it is stored; what
        came since is no part of the next one either, which then lacks samples.
        """
        if self._path is None or (self.is_open and self._origin == self._held):
            return None
        begin_s, state = time.monotonic(), self.twin.snapshot()
        return partial(self._save, self._path, self._origin, state, time.monotonic() - begin_s)

    def flush(self) -> None:
        """Have the disk keep the last snapshot over a power cut."""
        if self._path is not None:
            flush([self._path])

    @property
    def is_resting(self) -> bool:
        """Whether the last snapshot, of a long cycle, cost too much for another one now."""
        return time.monotonic() < self._rests_until_s

    def _save(self, path: Path, origin: Origin, state: TwinState, taken_s: float) -> None:
        begin_s = time.monotonic()
        try:
            save_snapshot(path, origin, state)
        except OSError as err:
            raise StoreError(unwritable(path, err)) from err
        finally:
            end_s = time.monotonic()
            self._rests_until_s = end_s + REST * (taken_s + end_s - begin_s)

    def _restore(self, recent: Callable[[], Sequence[Estimate]]) -> None:
        if self._path is None:
            return
        try:
            state = load_snapshot(self._path, self._origin, recent)
        except StoreError as err:
            self._tell(str(err))
            self._forget_file()
            return
        if state is not None:
            self._held = self._origin
            self.twin.restore(_counted_anew(state))
            self._open(state)

    def _open(self, state: TwinState) -> None:
        """Wait for the samples that tell whether the stream goes on."""
        waiting = [cycle for _, cycle in state.jobs if cycle is not None]
        if self.last_cycle and self._resume is not None:
            since_ns = self._resume.start_ns
        elif state.segmenter.begin_ns is not None:
            since_ns = state.segmenter.begin_ns
        else:
            since_ns = state.aligner.tracks[POSITION].last_ns or 0
        closed_ns = waiting[-1].start_ns if waiting else since_ns
        self._closed = waiting[-1] if waiting else None
        self._rejoin = Rejoin(
            state,
            self._config.period_s,
            self._config.hold_back_s,
            since_ns=since_ns,
            closed_ns=closed_ns,
        )

    def _settle(self) -> list[Event]:
        """Let the twin go on, or begin anew after the last closed cycle, with what came."""
        assert self._rejoin is not None
        rejoin, self._rejoin = self._rejoin, None
        name, number = self._config.name, self.twin.cycle
        events: list[Event] = []
        if rejoin.goes_on:
            if not rejoin.is_sure:
                self.twin.mark_irreproducible()
            self._tell(f"{name}: goes on where it ended, {_where(number)}")
        else:
            self._forget_file()
            events += self.twin.leave_out(*self._last_closed())
            left = f": cycle {number}, which was running, is left out" if number else ""
            self._tell(f"{name}: samples are missing since it ended{left}")
        for parts in rejoin.rounds():
            events += self.twin.push_round(parts)
        return events

    def _last_closed(self) -> tuple[int, Resume | None]:
        if self._closed is None:
            return self.last_cycle, self._resume
        cycle, announced = self._closed, self._claim.announced
        return cycle.number, Resume(cycle.start_ns, cycle.end_ns, announced)

    def _forget_file(self) -> None:
        """Take the snapshot away: cycles that are told of from here on are not in it."""
        if self._path is not None:
            with suppress(OSError):  # it is replaced within a second
                self._path.unlink(missing_ok=True)


def _where(number: int) -> str:
    return f"inside cycle {number}" if number else "between two cycles"


def _counted_anew(state: TwinState) -> TwinState:
    """Return a state whose bad samples were all told of; how many came tells how often they do."""
    tracks = tuple(replace(t, counts=(t.counts[0], 0, 0, 0)) for t in state.aligner.tracks)
    return replace(state, aligner=replace(state.aligner, tracks=tracks))


def _digest(config: ValveConfig) -> str:
    """Return what a state depends on of a configuration and of its model, in short."""
    model, signals = get_model(config.model), sorted(config.signals.items())
    form = (model.name, [p.name for p in model.parameters], model.initial_state().tolist())
    parts = (config.period_s, config.hold_back_s, config.cycles, config.options)
    return hashlib.sha256(repr((form, signals, parts)).encode()).hexdigest()


@cache
def build_of(model: str) -> str:
    """Return what changes with the code of the core and of a model, by its name.

    The arrays of a state carry no names: the same numbers mean something else to other code.
    """
    folder = os.path.dirname(str(core.__file__))
    found = (os.path.join(at, n) for at, _, names in os.walk(folder) for n in names)
    files = sorted(file for file in found if file.endswith(".py"))
    spec = find_spec(model_module(model) or core.__name__)
    if spec is not None and spec.origin is not None and not spec.name.startswith(core.__name__):
        own = Path(spec.origin)
        whole = (own.parent / "__init__.py").exists()
        files += sorted(map(str, own.parent.glob("*.py"))) if whole else [str(own)]
    digest = hashlib.blake2b(digest_size=32)  # a third of the time of SHA-256 without OpenSSL
    for file in files:
        with open(file, "rb") as source:
            digest.update(os.path.basename(file).encode() + b"\0" + source.read() + b"\0")
    return digest.hexdigest()
