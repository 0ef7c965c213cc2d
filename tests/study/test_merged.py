"""Iterators side by side: nothing lost, in order, and no thread left behind."""

from __future__ import annotations

import threading
import time
from contextlib import closing
from itertools import count

import pytest

from realitygap.study import jobs
from realitygap.study.jobs import merged


def test_all_comes_and_in_order():
    """Of each source; more than wait at a time, in lists of many and of none."""

    def counting(name):
        for k in range(500):
            yield [(name, k)] if k % 3 else []

    sources = [counting(name) for name in "ab"]
    found = [item for items in merged(sources) for item in items]
    for name in "ab":
        assert [item for item in found if item[0] == name] == [(name, k) for k in range(500) if k % 3]
    assert list(merged([])) == []


def test_an_error_ends_all():
    """What came before it comes; the other source, which never ends, does."""

    def failing():
        yield [1]
        raise KeyboardInterrupt

    before, heard = threading.active_count(), []
    with pytest.raises(KeyboardInterrupt):
        for items in merged([failing(), ([] for _ in count())]):
            heard += items
    assert heard == [1] and threading.active_count() == before


def test_no_thread_is_left_when_nobody_listens(monkeypatch):
    """Neither one that waits for room nor one that has nothing to tell."""
    monkeypatch.setattr(jobs, "MOST", 2)
    before, made = threading.active_count(), []
    sources = [([made.append(k)] for k in count()), ([] for _ in count())]
    with closing(merged(sources)) as bundles:
        next(bundles)
        assert threading.active_count() == before + 2
        time.sleep(0.2)
        assert len(made) < 20
    assert threading.active_count() == before
