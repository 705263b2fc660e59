# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
from valve_twin.io.cdr.codec import encode_stamped
from valve_twin.io.recording.ring_buffer import OVERHEAD, CycleSpan, RecordedMessage, RingBuffer

PERIOD_NS = 10_000_000
SECOND_NS = 1_000_000_000
FAR = 10**15


def sample(number: int, topic: str = "/position", late_ns: int = 0) -> RecordedMessage:
    """A stamped message; it arrives at another time than its stamp says."""
    stamp = number * PERIOD_NS
    log_ns = FAR + stamp + late_ns
    return RecordedMessage(topic, encode_stamped(stamp, float(number)), log_ns, stamp)


def plain(number: int) -> RecordedMessage:
    return RecordedMessage("/plain", b"\0\1\0\0text", FAR + number * PERIOD_NS + 1, 0)


def ring(**options) -> RingBuffer:
    made = RingBuffer(**{"seconds": 0.0, "size": 10**9, **options})
    made.describe("/position", stamped=True, latched=False)
    made.describe("/plain", stamped=False, latched=False)
    made.describe("/verdict", stamped=True, latched=True)
    return made


def cycle(number: int, first: int, last: int) -> CycleSpan:
    return CycleSpan(number, first * PERIOD_NS, last * PERIOD_NS)


def numbers(messages, topic: str = "/position") -> list[int]:
    return [m.publish_ns // PERIOD_NS for m in messages if m.topic == topic]


def test_it_spans_the_time_asked_for():
    buffer = ring(seconds=1.0)
    for i in range(500):
        buffer.push(sample(i))
    assert buffer.duration_s == 1.0
    assert numbers(buffer.take().messages) == list(range(399, 500))
    assert len(buffer) == buffer.size == 0


def test_it_takes_the_memory_allowed():
    size = len(sample(0).data) + OVERHEAD
    buffer = ring(size=10 * size)
    for i in range(500):
        buffer.push(sample(i))
        assert buffer.size <= 10 * size
    assert numbers(buffer.take().messages) == list(range(490, 500))


def test_one_message_above_the_memory_allowed_is_kept():
    buffer = ring(size=1)
    buffer.push(sample(1))
    buffer.push(sample(2))
    assert numbers(buffer.take().messages) == [2]


def test_a_snapshot_holds_the_last_whole_cycles_and_nothing_else():
    buffer = ring(cycles=2)
    spans = [cycle(k, 100 * k, 100 * k + 99) for k in range(5)]
    for i in range(550):
        buffer.push(sample(i))
        buffer.push(plain(i))
        if i % 100 == 30 and i > 100:  # a cycle is announced a while after its end
            buffer.end_cycle(spans[i // 100 - 1])
    taken = buffer.take()
    assert taken.cycles == (spans[3], spans[4])
    assert numbers(taken.messages) == list(range(300, 500))
    assert len([m for m in taken.messages if m.topic == "/plain"]) == 199
    assert numbers(buffer.take().messages) == list(range(500, 550))


def test_samples_that_come_out_of_order_go_to_their_cycle():
    buffer = ring(cycles=1)
    for i in (0, 1, 5, 2, 3, 6, 4, 7):
        buffer.push(sample(i))
    buffer.end_cycle(cycle(1, 1, 4))
    assert sorted(numbers(buffer.take().messages)) == [1, 2, 3, 4]
    assert numbers(buffer.take().messages) == [5, 6, 7]


def test_what_lies_before_the_last_cycles_is_let_go():
    buffer = ring(cycles=2)
    for i in range(1000):
        buffer.push(sample(i))
        if i % 100 == 99:
            buffer.end_cycle(cycle(i // 100, i - 99, i))
    assert len(buffer) == 200


def test_a_cycle_whose_begin_was_not_seen_is_not_whole():
    buffer = ring(cycles=3)
    for i in range(50, 300):
        buffer.push(sample(i))
    for k in range(3):
        buffer.end_cycle(cycle(k, 100 * k, 100 * k + 99))
    taken = buffer.take()
    assert [c.number for c in taken.cycles] == [1, 2]
    assert numbers(taken.messages) == list(range(100, 300))


def test_without_a_whole_cycle_everything_is_taken():
    buffer = ring(cycles=2)
    for i in range(10):
        buffer.push(sample(i))
    taken = buffer.take()
    assert taken.cycles == ()
    assert numbers(taken.messages) == list(range(10))


def test_a_clock_that_goes_back_begins_anew():
    buffer = ring(cycles=2)
    for i in range(100, 300):
        buffer.push(sample(i))
    buffer.end_cycle(cycle(1, 100, 199))
    buffer.end_cycle(cycle(2, 200, 299))
    for i in range(100):
        buffer.push(sample(i))
    buffer.end_cycle(cycle(0, 0, 99))
    taken = buffer.take()
    assert [c.number for c in taken.cycles] == [0]
    assert numbers(taken.messages) == list(range(100))


def test_the_latched_state_before_the_begin_comes_first_at_its_time():
    buffer = ring(seconds=1.0)
    buffer.push(sample(0, "/verdict"))
    buffer.push(sample(1, "/verdict"))
    for i in range(2, 500):
        buffer.push(sample(i))
    first, second = buffer.take().messages[:2]
    assert (first.topic, first.publish_ns) == ("/verdict", PERIOD_NS)
    assert first.log_ns == second.log_ns
    buffer.push(sample(600))
    assert buffer.take().messages[0].topic == "/verdict"
