# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Who keeps up gets what is new, who does not the whole window; who feeds never waits."""

from __future__ import annotations

import asyncio
import json
from typing import Any

import numpy as np

from valve_twin.gateway.live import channel
from valve_twin.gateway.live.channel import STALE_S, Channels, LiveValve

BEGIN_NS = 1_700_000_000 * 10**9


def feed(valve: LiveValve, second: int) -> None:
    t = BEGIN_NS + second * 10**9 + np.arange(0, 10**9, 10**7, dtype=np.int64)
    valve.take(t, {"measured": np.full(100, 0.5)}, 0.001, 3)


def look(valve: LiveValve) -> dict[str, Any]:
    frame = valve.frame()
    return content(frame.more or valve.whole(frame))


def content(event: bytes) -> dict[str, Any]:
    assert event.startswith(b"data: ")
    assert event.endswith(b"\n\n")
    found: dict[str, Any] = json.loads(event[6:])
    return found


def test_a_valve_waits_is_live_and_becomes_stale():
    now = 0.0
    valve = LiveValve(clock=lambda: now)
    valve.join()
    assert look(valve)["state"] == "waiting"
    now = STALE_S + 0.1
    assert look(valve)["state"] == "stale"
    feed(valve, 0)
    assert look(valve)["state"] == "live"
    now += STALE_S + 0.1
    told = look(valve)
    assert (told["state"], told["quiet"]) == ("stale", 2)
    assert told["values"]["measured"] == "0.50000"
    assert told["values"]["cycle"] == "3"


def test_it_is_told_when_the_first_comes_and_the_last_goes(monkeypatch):
    monkeypatch.setattr(channel, "TICK_S", 0.01)
    told: list[bool] = []
    valve = LiveValve(told.append)
    channels = Channels({"/v": valve})
    assert "/v" in channels
    assert "/w" not in channels

    async def look() -> None:
        viewers = [channels.events("/v") for _ in range(3)]
        firsts = [await anext(v) for v in viewers]
        assert set(firsts) == {b"retry: 1000\n\n"}
        for second in range(4):
            feed(valve, second)
            events = [content(e) for e in await asyncio.gather(*map(anext, viewers))]
            assert len({json.dumps(e) for e in events}) == 1
            assert ("axes" in events[0]) == (second == 0)
        late = channels.events("/v")
        await anext(late)
        feed(valve, 4)
        more, whole = map(content, await asyncio.gather(*map(anext, (viewers[0], late))))
        assert ("axes" in more, "axes" in whole) == (False, True)
        assert whole["slices"][-1] == more["slices"][-1]
        for _ in range(3):  # one that does not read misses frames and gets the whole window
            await anext(late)
        assert "axes" in content(await anext(viewers[1]))
        for viewer in (*viewers, late):
            await viewer.aclose()

    asyncio.run(look())
    assert told == [True, False]
    assert not channels.full


def test_closing_lets_all_go(monkeypatch):
    monkeypatch.setattr(channel, "TICK_S", 0.01)
    channels = Channels({"/v": LiveValve()})

    async def look() -> int:
        count = 0
        async for _ in channels.events("/v"):
            count += 1
            if count == 2:
                channels.close()
        return count

    assert asyncio.run(look()) == 2


def test_each_turn_comes_once_a_tick_however_late_or_early_a_timer_is():
    for turn_s in (0.0, 0.05, 0.15):
        now_s, due_s = 7.03, list[float]()
        for late_s in (0.0, -1e-9, 1e-9, 0.04, 0.0, -1e-9):
            due_s.append(now_s + channel._until(turn_s, now_s))
            now_s = due_s[-1] + late_s
        steps = np.diff(due_s)
        assert np.allclose(steps, channel.TICK_S), steps
        assert np.allclose((np.array(due_s) - turn_s + 0.1) % channel.TICK_S, 0.1)
