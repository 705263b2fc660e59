# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The order of the waiting jobs, and what is known of the next one."""

from valve_twin.core.job_queue import JobQueue


def test_jobs_come_in_their_order_and_a_dropped_one_is_seen_ahead():
    queue = JobQueue([(1, None)])
    assert queue.begins_dropped
    queue.append(2, None)
    assert [ordinal for ordinal, _ in queue] == [1, 2]
    assert len(queue) == 2, "looking takes none"
    assert [queue.popleft(), queue.popleft()] == [(1, None), (2, None)]
    assert not queue.begins_dropped
