"""A user's own things about one data set: saved selections, notes, tags, history.

One JSON file per data set under `$XDG_DATA_HOME/s2rtui/` (default `~/.local/share`), never in the
store. Every change reads the file again under a lock, so that two sessions keep both their work.
"""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from s2rstore.errors import RequestError
from s2rstore.language import ExpressionError, Node, parse
from s2rstore.language.nodes import Ids, Saved, leaves
from s2rstore.layout import write_atomic
from s2rtui.own import own_folder

_VERSION = 1
_MOST_HISTORY = 500
_MOST_TEXT = 2000


@dataclass(frozen=True, slots=True)
class SavedSelection:
    """An expression with the generation and run that it was saved at, and its count there."""

    expression: str
    generation: int
    run: str
    count: int


@dataclass(frozen=True, slots=True)
class Remark:
    """What a user wrote about one instance."""

    tags: tuple[str, ...] = ()
    note: str = ""

    @property
    def text(self) -> str:
        """`#door #dark: looks overexposed`"""
        tags = " ".join(f"#{tag}" for tag in self.tags)
        return ": ".join(part for part in (tags, self.note) if part)


@dataclass(frozen=True)
class Notes:
    """The content of a notebook, never changed in place."""

    selections: Mapping[str, SavedSelection] = field(default_factory=dict)
    remarks: Mapping[int, Remark] = field(default_factory=dict)
    history: tuple[str, ...] = ()

    @cached_property
    def nodes(self) -> dict[str, Node]:
        """Saved selections and tags as the language's `@name`; selections come first."""
        tagged: dict[str, list[int]] = {}
        for iid in sorted(self.remarks):
            for tag in self.remarks[iid].tags:
                tagged.setdefault(tag, []).append(iid)
        nodes: dict[str, Node] = {
            tag: Ids(tuple((iid, iid) for iid in iids)) for tag, iids in tagged.items()
        }
        return nodes | {name: parse(saved.expression) for name, saved in self.selections.items()}


class Notebook:
    """The notebook of one data set; `notes` is what was read last."""

    def __init__(self, dataset_hash: str, folder: Path | None = None) -> None:
        """Raises RequestError where the file is damaged or cannot be read."""
        self._hash = dataset_hash
        self.path = (folder or own_folder()) / f"{dataset_hash[:16]}.json"
        self.notes = self._read()

    def refresh(self) -> None:
        """Read what other sessions have written. Raises RequestError for a damaged file."""
        self.notes = self._read()

    def save(self, name: str, saved: SavedSelection) -> None:
        """Keep a selection under a name, in place of an earlier one."""
        name = checked(name, "name")

        def change(notes: Notes) -> Notes:
            if name in _needs(saved.expression, notes):
                raise RequestError(f"@{name} is part of this selection; choose another name")
            if any(name in remark.tags for remark in notes.remarks.values()):
                raise RequestError(f"@{name} is a tag already; choose another name")
            return replace(notes, selections={**notes.selections, name: saved})

        self._change(change)

    def forget(self, name: str) -> None:
        """Drop a saved selection that no other one needs."""

        def change(notes: Notes) -> Notes:
            for other, saved in notes.selections.items():
                if other != name and name in _needs(saved.expression, notes):
                    raise RequestError(f"@{name} is part of @{other}: forget that one first")
            kept = {key: value for key, value in notes.selections.items() if key != name}
            return replace(notes, selections=kept)

        self._change(change)

    def note(self, iid: int, text: str) -> None:
        """What is to be remembered of an instance; an empty text removes it."""
        text = " ".join(text.split())[:_MOST_TEXT].encode("utf-8", "replace").decode()
        self._change(lambda notes: _remarked(notes, iid, note=text))

    def toggle_tag(self, iids: list[int], tag: str) -> bool:
        """Tag some instances, or take the tag off where all of them have it; True where tagged."""
        tag = checked(tag.lstrip("#"), "tag")
        tagged = True

        def change(notes: Notes) -> Notes:
            nonlocal tagged
            if tag in notes.selections:
                raise RequestError(f"@{tag} is a saved selection already; choose another tag")
            remarks = dict(notes.remarks)
            tagged = not all(tag in remarks.get(iid, Remark()).tags for iid in iids)
            for iid in iids:
                remark = remarks.get(iid, Remark())
                others = tuple(known for known in remark.tags if known != tag)
                remarks[iid] = replace(remark, tags=(*others, tag) if tagged else others)
                if remarks[iid] == Remark():
                    del remarks[iid]
            return replace(notes, remarks=remarks)

        self._change(change)
        return tagged

    def remember(self, expressions: tuple[str, ...]) -> None:
        """Add to the history; the latest stand last and only once."""

        def change(notes: Notes) -> Notes:
            fresh = dict.fromkeys(reversed((*notes.history, *expressions)))
            return replace(notes, history=tuple(reversed(list(fresh)[:_MOST_HISTORY])))

        self._change(change)

    def _change(self, change: Callable[[Notes], Notes]) -> None:
        with self._lock():
            notes = change(self._read())
            try:
                write_atomic(self.path, self._written(notes))
            except OSError as error:
                raise RequestError(f"{self.path}: {error.strerror}") from error
        self.notes = notes

    @contextmanager
    def _lock(self) -> Iterator[None]:
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            descriptor = os.open(self.path.with_suffix(".lock"), os.O_RDWR | os.O_CREAT, 0o600)
        except OSError as error:
            raise RequestError(f"{self.path.parent}: {error.strerror}") from error
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX)
            yield
        finally:
            os.close(descriptor)

    def _written(self, notes: Notes) -> bytes:
        content = {
            "version": _VERSION,
            "dataset": self._hash,
            "selections": {name: asdict(saved) for name, saved in notes.selections.items()},
            "remarks": {
                str(iid): {"tags": list(remark.tags), "note": remark.note}
                for iid, remark in sorted(notes.remarks.items())
            },
            "history": list(notes.history),
        }
        return (json.dumps(content, indent=1, ensure_ascii=False) + "\n").encode()

    def _read(self) -> Notes:
        try:
            content = json.loads(self.path.read_text(encoding="utf-8"))
        except FileNotFoundError:
            return Notes()
        except (OSError, ValueError) as error:
            raise RequestError(f"{self.path}: cannot be read; move it away ({error})") from error
        try:
            return self._parsed(content)
        except (KeyError, TypeError, ValueError, AttributeError, ExpressionError) as error:
            raise RequestError(f"{self.path}: is no notebook; move it away") from error

    def _parsed(self, content: Any) -> Notes:
        if content["version"] != _VERSION or content["dataset"] != self._hash:
            raise ValueError("of another version or data set")
        selections = {
            checked(name, "name"): SavedSelection(
                str(saved["expression"]), int(saved["generation"]), str(saved["run"]),
                int(saved["count"]),
            )
            for name, saved in content["selections"].items()
        }  # fmt: skip
        remarks = {
            int(iid): Remark(tuple(str(tag) for tag in remark["tags"]), str(remark["note"]))
            for iid, remark in content["remarks"].items()
        }
        notes = Notes(selections, remarks, tuple(str(text) for text in content["history"]))
        _ = notes.nodes
        return notes


class ReadNotebook(Notebook):
    """A notebook that is read and never written: of commands, and of pictures of the screen."""

    def _change(self, change: Callable[[Notes], Notes]) -> None:
        raise RequestError("nothing is kept in this session")


def first_run() -> bool:
    """Whether this user opens the application for the first time; asked once, it is so no more."""
    marker = own_folder() / "toured"
    if marker.exists():
        return False
    try:
        marker.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        marker.touch()
    except OSError:
        return False
    return True


def checked(name: str, what: str) -> str:
    """A name of a selection or a tag, without blanks around it. Raises RequestError."""
    name = name.strip().lstrip("@")
    if not name or len(name) > 60 or not name.isprintable() or '"' in name or "\\" in name:
        raise RequestError(f"{what}: 1 to 60 printable characters without quotes")
    return name


def _needs(expression: str, notes: Notes) -> set[str]:
    """The saved names that an expression is made of, directly or through others."""
    found: set[str] = set()
    waiting = [parse(expression)]
    while waiting:
        for leaf in leaves(waiting.pop()):
            if isinstance(leaf, Saved) and leaf.name not in found:
                found.add(leaf.name)
                if leaf.name in notes.nodes:
                    waiting.append(notes.nodes[leaf.name])
    return found


def _remarked(notes: Notes, iid: int, **changes: Any) -> Notes:
    remark = replace(notes.remarks.get(iid, Remark()), **changes)
    kept = {key: value for key, value in notes.remarks.items() if key != iid}
    if remark != Remark():
        kept[iid] = remark
    return replace(notes, remarks=kept)
