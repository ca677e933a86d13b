"""Validated messages between a page, the server and its session.

A page sends JSON texts `[kind, value]`. A session reads and writes packets: one letter (D for data,
M for meta), the length of the payload in 4 bytes, big-endian, and the payload, which is JSON for M.
"""

from __future__ import annotations

import json
from dataclasses import dataclass

from s2rtui.terminal.capabilities import within_bounds

MAX_MESSAGE_BYTES = 1 << 17
"""Largest message of a page."""
MAX_PACKET_BYTES = 1 << 26
"""Largest packet of a session; the largest screen needs less than half."""
_MAX_PING_CHARACTERS = 64
_MAX_CELLS = 1_000_000


class MessageError(ValueError):
    """Raised for a message that no page of this server sends."""


@dataclass(frozen=True, slots=True)
class Ping:
    """Request for a reply with the same text."""

    text: str


def packet(kind: bytes, payload: bytes) -> bytes:
    return kind + len(payload).to_bytes(4, "big") + payload


def meta(kind: str, **values: int) -> bytes:
    return packet(b"M", json.dumps({"type": kind, **values}).encode())


def read_message(text: str) -> bytes | Ping:
    """Return the packet for the session, or the ping, of a page's message. Raises MessageError."""
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
        case ["ping", str(text)] if len(text) <= _MAX_PING_CHARACTERS:
            return Ping(text)
        case ["focus" | "blur" as kind]:
            return meta(kind)
    raise MessageError("unknown message")


def _cells(value: object) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= _MAX_CELLS:
        raise MessageError("not a size")
    return value


def initial_size(width: str, height: str) -> tuple[int, int]:
    """Return the columns and rows in the address of a page's socket; 80 x 24 if invalid."""
    is_valid = width.isascii() and height.isascii() and len(width) < 8 and len(height) < 8
    if not (is_valid and width.isdecimal() and height.isdecimal()):
        return 80, 24
    return within_bounds(int(width), int(height))
