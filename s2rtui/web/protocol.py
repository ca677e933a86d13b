"""Messages between a page, the server and its session: checked before anything is done with them.

A page sends JSON texts `[kind, value]`. A session takes and gives packets: one letter, D for data
or M for meta, the length in 4 bytes, big-endian, and the payload, which is JSON for M.
"""

from __future__ import annotations

import json
from dataclasses import dataclass

from s2rtui.terminal.size_limits import within_bounds

LONGEST_MESSAGE = 1 << 17
"""Bytes of one message of a page."""
LARGEST_PACKET = 1 << 26
"""Bytes of one packet of a session; a screen of the largest size takes less than half."""
_LONGEST_PING = 64
_LARGEST_SIZE = 1_000_000


class MessageError(ValueError):
    """A message that no page of this server sends."""


@dataclass(frozen=True, slots=True)
class Ping:
    """Asks for the same text back."""

    text: str


def packet(kind: bytes, payload: bytes) -> bytes:
    return kind + len(payload).to_bytes(4, "big") + payload


def meta(kind: str, **values: int) -> bytes:
    return packet(b"M", json.dumps({"type": kind, **values}).encode())


def read_message(text: str) -> bytes | Ping:
    """The packet for the session that a page's message means. Raises MessageError."""
    try:
        message = json.loads(text)
    except (ValueError, RecursionError):
        raise MessageError("not JSON") from None
    if not isinstance(message, list):
        raise MessageError("not a list")
    match message:
        case ["stdin", str(keys)]:
            return packet(b"D", keys.encode("utf-8", "replace"))
        case ["resize", {"width": width, "height": height}]:
            columns, rows = within_bounds(_cells(width), _cells(height))
            return meta("resize", width=columns, height=rows)
        case ["ping", str(sent)] if len(sent) <= _LONGEST_PING:
            return Ping(sent)
        case ["focus" | "blur" as kind]:
            return meta(kind)
    raise MessageError("unknown message")


def _cells(value: object) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= _LARGEST_SIZE:
        raise MessageError("not a size")
    return value


def first_size(width: str, height: str) -> tuple[int, int]:
    """Columns and rows that the address of a page's socket names; 80 x 24 for anything else."""
    short = width.isascii() and height.isascii() and len(width) < 8 and len(height) < 8
    if not (short and width.isdecimal() and height.isdecimal()):
        return 80, 24
    return within_bounds(int(width), int(height))
