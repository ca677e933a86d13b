from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

import pytest

from s2rstore.errors import RequestError


@pytest.fixture
def one_line() -> Callable[..., AbstractContextManager[None]]:
    """Expect a RequestError of one line that contains the given texts."""

    @contextmanager
    def expect(*texts: str) -> Iterator[None]:
        with pytest.raises(RequestError) as caught:
            yield
        message = str(caught.value)
        assert "\n" not in message
        for text in texts:
            assert text in message

    return expect
