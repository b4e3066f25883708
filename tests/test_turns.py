"""Who is timed is alone; those who compute are not."""

import multiprocessing
import time

from compare import turns

CONTEXT = multiprocessing.get_context("spawn")


def hold(path, how, log, name, seconds):
    turns.join(path)
    with getattr(turns, how)():
        log.put((name, "in", time.monotonic()))
        time.sleep(seconds)
        log.put((name, "out", time.monotonic()))


def spans(tmp_path, *hows):
    log = CONTEXT.Queue()
    children = [
        CONTEXT.Process(target=hold, args=(tmp_path / "lock", how, log, i, 0.4)) for i, how in enumerate(hows)
    ]
    for child in children:
        child.start()
    found = {(name, edge): t for name, edge, t in (log.get(timeout=60) for _ in range(2 * len(hows)))}
    for child in children:
        child.join()
    return [(found[i, "in"], found[i, "out"]) for i in range(len(hows))]


def overlap(a, b):
    return min(a[1], b[1]) - max(a[0], b[0])


def test_nobody_computes_or_is_timed_beside_one_who_is_timed(tmp_path):
    a, b, c = spans(tmp_path, "timed", "computing", "timed")
    assert max(overlap(a, b), overlap(a, c), overlap(b, c)) <= 1e-3


def test_a_process_that_joined_no_lock_waits_for_nobody():
    with turns.timed(), turns.computing():
        pass
