# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the speaker says and takes as delivered, and the marks that it keeps, without a broker."""

from __future__ import annotations

import errno
import json
import math
import os
import queue
import random
import shutil
from dataclasses import replace
from types import SimpleNamespace

import pytest

pytest.importorskip("pysparkplug", reason="needs the extra gateway")

from typing import TYPE_CHECKING

from pysparkplug import DataType, DData, Metric

from test.gateway.fmu.test_valve import made
from test.peak import forget_peak, peak_mb
from valve_twin.gateway.mqtt import backlog as backlog_module
from valve_twin.gateway.mqtt import face
from valve_twin.gateway.mqtt.backlog import Backlog
from valve_twin.gateway.mqtt.broker import Broker
from valve_twin.gateway.mqtt.sparkplug import (
    MOST_SILENT,
    UNCONFIRMED_S,
    SparkplugSpeaker,
    _metrics,
)
from valve_twin.gateway.view import View
from valve_twin.io.errors import ConfigError, StoreError
from valve_twin.io.history.fleet import FleetRow

if TYPE_CHECKING:
    from pathlib import Path


class Past:
    """Stored cycles 1 .. n of valves; counts how often it is asked.

    Those from `later` on were made after all others, as behind a backup, or before: `step` [ns].
    """

    def __init__(self, **last):
        self.last, self.asked, self.later, self.step = last, 0, math.inf, 10**6

    def end_ns(self, cycle):
        return cycle + self.step * (cycle >= self.later)

    def read(self, valve, first, limit):
        self.asked += 1
        cycles = range(first, min(first + limit, self.last[valve] + 1))
        return [replace(made(cycle), end_ns=self.end_ns(cycle)) for cycle in cycles]

    def view(self):
        rows = (FleetRow(v, cycle=n, end_ns=self.end_ns(n)) for v, n in self.last.items())
        return View(tuple(rows))


@pytest.fixture
def past():
    return Past(a=3, b=2)


@pytest.fixture
def speaker(past, tmp_path):
    """Return a speaker that owes all cycles."""
    (tmp_path / "state").write_text('{"of": "a broker", "birth": 0, "valves": {}}')
    said = SparkplugSpeaker("group", "node", Backlog(tmp_path / "state", past.read, "a broker"))
    said.will()
    said.born(past.view())
    yield said
    said.backlog.close()


def test_only_what_was_sent_byte_by_byte_is_delivered(speaker, past):
    sent = speaker.missed(past.view())
    assert len(sent) == 5
    forged = DData(0, 0, (Metric(0, "cycles/cycle", DataType.INT64, value=1),))
    for device in ("a", "b"):
        speaker.heard(f"spBv1.0/group/DDATA/node/{device}", forged.encode(include_dtypes=True))
    speaker.born(past.view())
    assert len(speaker.missed(past.view())) == 5  # nothing counts as delivered
    speaker.born(past.view())
    for message in speaker.missed(past.view()):
        speaker.heard(message.topic, message.payload)
    speaker.born(past.view())
    assert speaker.missed(past.view()) == []


def test_what_was_delivered_last_is_kept_over_a_clean_end(speaker, past, tmp_path):
    for message in speaker.missed(past.view()):
        speaker.heard(message.topic, message.payload)
    speaker.farewell()
    kept = json.loads((tmp_path / "state").read_text())
    assert kept["valves"] == {"a": 3, "b": 2}


def test_what_comes_back_of_a_valve_that_is_gone_is_no_error(speaker, past):
    view = past.view()
    sent = speaker.missed(view)
    speaker.changed(replace(view, rows=view.rows[1:]))
    for message in sent:
        assert speaker.heard(message.topic, message.payload) is False


def test_every_key_has_a_metric_of_its_own(past):
    view = past.view()
    row = replace(view.rows[0], stroke_test="fail", stroke_test_ns=10**18)
    names = [name for name, _ in _metrics(view, row)]
    assert len(names) == len(set(names)) > 30
    metrics = dict(_metrics(view, row))
    assert metrics["stroke_test"].value == "fail"
    assert metrics["stroke_test_time"].datatype is DataType.DATETIME


def test_a_stamp_before_1970_spoils_nothing(past, tmp_path):
    view = past.view()
    view = replace(view, rows=(replace(view.rows[0], end_ns=-5), view.rows[1]))
    (tmp_path / "state").write_text('{"of": "a broker", "birth": 0, "valves": {}}')

    def read(valve, first, limit):
        return [replace(e, end_ns=-(10**18)) for e in past.read(valve, first, limit)]

    speaker = SparkplugSpeaker("group", "node", Backlog(tmp_path / "state", read, "a broker"))
    assert len(speaker.born(view)) == 3
    assert len(speaker.missed(view)) == 5
    speaker.backlog.close()


def test_a_broker_that_hid_our_data_is_not_believed_on_the_next_connection(
    speaker, past, monkeypatch
):
    now = [0.0]
    monkeypatch.setattr("valve_twin.gateway.mqtt.sparkplug.time.monotonic", lambda: now[0])
    speaker.missed(past.view())
    for _ in range(MOST_SILENT - 1):
        now[0] += 2.0 * UNCONFIRMED_S
        assert len(speaker.missed(past.view())) == 5
    speaker.will()
    speaker.born(past.view())
    for _ in range(MOST_SILENT + 1):
        assert speaker._silent < MOST_SILENT
        now[0] += 2.0 * UNCONFIRMED_S
        speaker.missed(past.view())
    assert speaker._silent == MOST_SILENT
    speaker.born(past.view())
    assert speaker.missed(past.view()) == []  # it is believed in the end


def test_a_view_that_was_gone_through_is_not_gone_through_again(speaker, past):
    view = past.view()
    speaker.missed(view)
    asked = past.asked
    for _ in range(3):
        assert speaker.missed(view) == speaker.changed(view) == []
    assert past.asked == asked
    past.last["a"] = 4
    assert len(speaker.missed(past.view())) == 1


def test_of_a_history_that_is_yet_to_be_read_nothing_counts_as_stored_later(tmp_path, past):
    backlog = Backlog(tmp_path / "state", past.read, "a broker")
    assert list(backlog.take(View(whole=False))) == []
    assert list(backlog.take(past.view())) == []  # a new file: what is stored so far is the past
    past.last["a"] += 1
    assert [(v, e.cycle) for v, e, _ in backlog.take(past.view())] == [("a", 4)]
    backlog.close()


@pytest.mark.parametrize("begins_anew", [False, True])
@pytest.mark.parametrize("confirmed", [False, True])
def test_behind_a_backup_no_cycle_is_lost_however_far_it_is_by_then(
    tmp_path, past, begins_anew, confirmed
):
    """The numbers behind it are given again: those up to the mark counted as told."""
    backlog = Backlog(tmp_path / "state", past.read, "a broker")
    assert list(backlog.take(past.view())) == []
    if confirmed:
        past.last["a"] = 5
        for valve, estimate, _ in backlog.take(past.view()):
            backlog.confirm(valve, estimate.cycle)
        backlog.save()
    mark, past.later = past.last["a"], 3
    if begins_anew:
        backlog.close()
        backlog = Backlog(tmp_path / "state", past.read, "a broker")
    past.last["a"] = mark + 2
    told = [e.cycle for v, e, _ in backlog.take(past.view()) if v == "a"]
    assert told == [*range(1, mark + 3)]
    for cycle in told:
        backlog.confirm("a", cycle)
    past.last["a"] += 1
    assert [e.cycle for v, e, _ in backlog.take(past.view()) if v == "a"] == [mark + 3]
    backlog.close()


@pytest.mark.parametrize("back", [48, 49, 50, 51, 99, 100])
@pytest.mark.parametrize("one_by_one", [False, True])
def test_a_clock_that_goes_back_between_two_cycles_makes_no_other_history(
    tmp_path, past, back, one_by_one
):
    """All was sent again, and without an end where the last of a page was the first of them."""
    past.later, past.step = back, -(10**6)
    backlog = Backlog(tmp_path / "state", past.read, "a broker")
    assert list(backlog.take(past.view())) == []
    told = []
    for last in range(4, 121) if one_by_one else (120,):
        past.last["a"] = last
        for _ in range(5):
            for valve, estimate, _ in backlog.take(past.view()):
                told.append(estimate.cycle)
                backlog.confirm(valve, estimate.cycle)
    assert told == [*range(4, 121)]
    backlog.close()


def test_marks_of_a_version_that_kept_no_times_go_on(tmp_path, past):
    (tmp_path / "state").write_text('{"of": "a broker", "birth": 7, "valves": {"a": 2, "b": 2}}')
    backlog = Backlog(tmp_path / "state", past.read, "a broker")
    assert [(v, e.cycle) for v, e, _ in backlog.take(past.view())] == [("a", 3)]
    backlog.confirm("a", 3)
    backlog.save()
    backlog.close()
    assert json.loads((tmp_path / "state").read_text())["ends"] == {"a": 3}


def test_a_device_whose_history_cannot_be_read_is_dead_until_it_can_and_owes_its_cycles(
    speaker, past
):
    (sent, *_) = speaker.missed(past.view())
    gone = replace(past.view(), failure="no disk", told=frozenset("b"))
    messages = speaker.changed(gone)
    assert [m.topic.split("/", 2)[2] for m in messages] == ["NDATA/node", "DDEATH/node/a"]
    assert speaker.changed(gone) == speaker.missed(gone) == []
    speaker.heard(sent.topic, sent.payload)  # on its way before
    past.last["a"] = 4
    back = speaker.changed(past.view()) + speaker.missed(past.view())
    assert [m.topic.split("/", 2)[2] for m in back] == [
        *("NDATA/node", "DBIRTH/node/a", "DDATA/node/a")
    ]


def test_what_is_stored_before_a_first_connection_is_owed_from_the_first_look_on(tmp_path, past):
    """A broker that came late, or a disk that took the marks late, was told nothing of it."""
    backlog = Backlog(tmp_path / "state", past.read, "a broker")
    for view in (View(whole=False), past.view()):
        backlog.look(view)
        backlog.next_birth()  # of a broker that is not there
        past.last["a"] += 1
    backlog.close()
    again = Backlog(tmp_path / "state", past.read, "a broker")
    past.last["a"] += 1
    again.look(past.view())
    assert [(v, e.cycle) for v, e, _ in again.take(past.view())] == [("a", n) for n in (4, 5, 6)]
    again.close()


def test_the_marks_belong_to_one_at_a_time(tmp_path, past):
    first = Backlog(tmp_path / "state", past.read, "a broker")
    with pytest.raises(StoreError, match=r"state: another `serve` keeps its marks there"):
        Backlog(tmp_path / "state", past.read, "a broker")
    first.next_birth()
    first.close()
    with pytest.raises(StoreError, match="holds the marks of a broker: name another file for b"):
        Backlog(tmp_path / "state", past.read, "b")
    Backlog(tmp_path / "state", past.read, "a broker").close()


def test_marks_whose_folder_was_deleted_belong_to_one_at_a_time_again(tmp_path, past):
    """The lock went with the folder: two told one broker as the same node."""
    path = tmp_path / "marks" / "state"
    first = Backlog(path, past.read, "a broker")
    first.next_birth()
    shutil.rmtree(path.parent)
    first.next_birth()
    assert path.exists()
    with pytest.raises(StoreError, match="another `serve` keeps its marks there"):
        Backlog(path, past.read, "a broker")
    shutil.rmtree(path.parent)
    second = Backlog(path, past.read, "a broker")
    with pytest.raises(StoreError, match="another `serve` keeps its marks there"):
        first.next_birth()
    second.next_birth()
    SparkplugSpeaker("group", "node", first).farewell()
    second.close()
    first.next_birth()
    first.close()


def test_marks_that_cannot_be_written_are_told_at_the_start(tmp_path, past):
    (tmp_path / "file").touch()
    with pytest.raises(StoreError, match=r"cannot be written"):
        Backlog(tmp_path / "file" / "state", past.read, "a broker")


@pytest.mark.parametrize("births", [0, 1])
def test_a_disk_that_never_took_a_mark_loses_no_cycle(tmp_path, past, monkeypatch, births, caplog):
    """What was stored before the next start counted as told, and births repeated their number."""
    backlog = Backlog(tmp_path / "state", past.read, "a broker")
    told = [backlog.next_birth() for _ in range(births)]

    def refuse(path: Path, _: str) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))

    refused = pytest.raises(
        StoreError, match="No space left on device: free some space; no broker"
    )
    with monkeypatch.context() as harm:
        harm.setattr(backlog_module, "write_whole", refuse)
        if births:
            with refused:
                list(backlog.take(past.view()))
        with refused:
            backlog.next_birth()
        backlog.save()  # of a farewell: has been said
    past.last.update(a=6, b=5)
    told.append(backlog.next_birth())
    first = 4 if births else 7  # from the first look on
    assert [e.cycle for v, e, _ in backlog.take(past.view()) if v == "a"] == [*range(first, 7)]
    backlog.close()
    again = Backlog(tmp_path / "state", past.read, "a broker")
    told.append(again.next_birth())
    assert len(set(told)) == len(told)
    assert [e.cycle for v, e, _ in again.take(past.view()) if v == "a"] == [*range(first, 7)]
    again.close()
    assert not caplog.records


def test_a_disk_that_takes_no_marks_any_more_keeps_no_cycle_from_the_broker(
    tmp_path, past, monkeypatch, caplog
):
    """The connection was given up for it, again and again."""
    (tmp_path / "state").write_text('{"of": "a broker", "birth": 0, "valves": {}}')
    backlog = Backlog(tmp_path / "state", past.read, "a broker")

    def refuse(path: Path, _: str) -> None:
        raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(path))

    with monkeypatch.context() as harm:
        harm.setattr(backlog_module, "write_whole", refuse)
        said = SparkplugSpeaker("group", "node", backlog)
        said.will()
        said.born(past.view())
        sent = said.missed(past.view())
        for message in sent:
            said.heard(message.topic, message.payload)
        assert len(sent) == 5
        assert said.missed(past.view()) == []
        said.farewell()
    told = [r.getMessage() for r in caplog.records]
    assert [t.partition("; after")[0] for t in told] == [
        f"{tmp_path / 'state'}: cannot be written: Read-only file system: make the disk writable"
        " again"
    ]
    backlog.save()
    assert caplog.records[-1].getMessage() == f"{tmp_path / 'state'}: is written again"
    backlog.close()
    kept = json.loads((tmp_path / "state").read_text())
    assert kept["valves"] == past.last


def test_a_password_in_an_address_is_refused_and_not_told():
    with pytest.raises(ConfigError, match="holds no user") as caught:
        Broker("mqtt://anna:secret@broker").place()
    assert "secret" not in str(caught.value)


def test_what_others_say_on_our_topics_is_none_of_ours_and_takes_no_memory(speaker, past):
    """10 MB of empty metrics took 500 MB: what comes back is compared, never taken apart."""
    sent = [m.payload for m in speaker.missed(past.view())]
    command, data = speaker.subscriptions
    rng = random.Random(1)
    forget_peak()
    before_mb = peak_mb()
    assert not speaker.heard(data.replace("+", "a"), b"\x12\x00" * 5_000_000)
    assert not speaker.heard(command, b"\x12\x00" * (face.LARGEST_HEARD // 2))
    for _ in range(1000):
        changed = bytearray(rng.choice(sent))
        changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
        topic = rng.choice((command, data.replace("+", rng.choice("ab"))))
        assert not speaker.heard(topic, bytes(changed[: rng.randrange(1, 400)]))
    assert peak_mb() - before_mb < 50.0
    assert len(speaker._sent) == len(sent)


def test_a_large_cycle_of_ours_is_known_as_it_comes_back_and_takes_no_memory(tmp_path):
    """Dropped as too large, it was sent again for ever, and all cycles behind it with it."""
    past = Past(a=3)
    reason = "x" * (4 * face.LARGEST_HEARD)

    def read(valve, first, limit):
        return [replace(e, reason=reason) for e in past.read(valve, first, limit)]

    (tmp_path / "state").write_text('{"of": "a broker", "birth": 0, "valves": {}}')
    speaker = SparkplugSpeaker("group", "node", Backlog(tmp_path / "state", read, "a broker"))
    speaker.will()
    speaker.born(past.view())
    sent = speaker.missed(past.view())
    events: queue.Queue[face._Event] = queue.Queue()
    forget_peak()
    before_mb = peak_mb()
    for message in sent * 100:  # whoever repeats them
        for content in (bytes(bytearray(message.payload)), bytes(len(message.payload))):
            back = SimpleNamespace(topic=message.topic, payload=content)
            face._hear(events, back, speaker.awaits)
    assert peak_mb() - before_mb < 20.0
    for _, given in list(events.queue):
        speaker.heard(given.topic, given.payload)
    speaker.farewell()
    speaker.backlog.close()
    assert json.loads((tmp_path / "state").read_text())["valves"] == {"a": 3}
