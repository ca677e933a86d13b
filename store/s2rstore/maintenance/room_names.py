"""Rename the rooms of a store."""

from __future__ import annotations

from pathlib import Path

from s2rstore.errors import RequestError
from s2rstore.geometry.rooms import NO_ROOM
from s2rstore.index.transaction import edit
from s2rstore.reader import Store
from s2rstore.records import MAX_TEXT
from s2rstore.security.printable_text import printable


def rename_room(root: Path, old: str, new: str) -> int:
    """Publish a generation in which a room has another name; returns its number of instances.

    Computed arrays stay valid, since none depends on names of rooms. Raises RequestError for an
    unknown room, and for a new name that another room has or that cannot be typed.
    """
    if not new.strip() or len(new) > MAX_TEXT or printable(new) != new or new != new.strip():
        raise RequestError(
            f"room name {new!r}: give 1 to {MAX_TEXT} printable characters, without blanks around"
        )
    if new == NO_ROOM:
        raise RequestError(f"room name {new!r}: stands for instances outside all rooms")
    with Store(root) as store:
        rooms, poses_known = store.stored_rooms, store.has_poses
    if not poses_known or old not in rooms:
        known = ", ".join(rooms) or "none"
        raise RequestError(f"room {old!r}: not in {root} (rooms: {known})")
    if new in rooms:
        raise RequestError(f"room {new!r}: exists already; rooms cannot be merged")
    with edit(root) as draft:
        for table in ("room", "instance"):
            draft.update(table, {"room": rooms[old]}, {"room": new})
        query = "SELECT count(*) FROM instance WHERE room = ?"
        ((count,),) = draft.rows(query, [new])
    return int(count)
