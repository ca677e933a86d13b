"""Calls made once after a while.

Textual's one-shot timers skip what is overdue: one that starts while the process stands still, for
as long as it is to wait, is never heard of.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from textual.message_pump import MessagePump


def later(pump: MessagePump, seconds: float, call: Callable[[], object]) -> asyncio.TimerHandle:
    """Have `pump` call it after so many seconds, unless the handle is cancelled before."""
    return asyncio.get_running_loop().call_later(seconds, pump.call_next, call)
