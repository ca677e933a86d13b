"""Items of a callback as an iterator."""

import threading
from itertools import islice

import pytest

from s2rtools.ros.callback_items import callback_items


def test_items_keep_their_order_and_an_error_follows_them():
    def run(put):
        for number in range(20):
            put(number)
        raise ValueError("damaged")

    items = callback_items(run)
    assert list(islice(items, 20)) == list(range(20))
    with pytest.raises(ValueError, match="damaged"):
        next(items)


def test_few_items_wait_and_closing_ends_the_function():
    begun, ended = [], threading.Event()

    def run(put):
        try:
            for number in range(1000):
                begun.append(number)
                put(number)
        finally:
            ended.set()

    items = callback_items(run, waiting=2)
    assert next(items) == 0
    assert len(begun) <= 4
    items.close()
    assert ended.is_set()
    assert len(begun) <= 5
