"""Delayed calls that are also made when the process was suspended meanwhile.

Textual's one-shot timers skip a call that is overdue, so a process that stands still for as long as
the delay would lose it.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from textual.message_pump import MessagePump


def call_after(
    pump: MessagePump, seconds: float, callback: Callable[[], object]
) -> asyncio.TimerHandle:
    """Call `callback` in a message pump after a delay, unless the handle is cancelled before."""
    return asyncio.get_running_loop().call_later(seconds, pump.call_next, callback)
