"""A user's own things about one data set: saved selections, notes, tags, history.

One JSON file per data set under `$XDG_DATA_HOME/s2rtui/` (default `~/.local/share`), never in the
store. Every change reads the file again under a lock, so that two sessions keep both their work;
entries that cannot be read are left as they are.
"""

from __future__ import annotations

import json
import os
import stat
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.files.atomic_writes import write_file
from s2rstore.files.layout import checked_hash
from s2rstore.files.locks import file_lock
from s2rstore.language import ExpressionError, Node, parse
from s2rstore.language.canonical_text import quoted
from s2rstore.language.syntax_tree import Ids, Saved, leaves
from s2rstore.security.printable_text import printable
from s2rtui.user_data import notebook_schema
from s2rtui.user_data.folder import own_folder
from s2rtui.user_data.notebook_schema import Remark, SavedSelection, Unread, checked

__all__ = ["Notebook", "Notes", "ReadNotebook", "Remark", "SavedSelection", "checked", "first_run"]

_MOST_HISTORY = 500
_MOST_TEXT = 2000
_MOST_BYTES = 32 * 2**20
"""Size of a notebook's file; 100,000 tagged instances take a fifth of it."""
_PATIENCE = 2.0
"""Seconds that another session's change is waited for."""


@dataclass(frozen=True)
class Notes:
    """The content of a notebook, never changed in place; `unread` are entries left as they are."""

    selections: Mapping[str, SavedSelection] = field(default_factory=dict)
    remarks: Mapping[int, Remark] = field(default_factory=dict)
    history: tuple[str, ...] = ()
    unread: Unread = field(default_factory=Unread)

    @cached_property
    def nodes(self) -> dict[str, Node]:
        """Saved selections and tags as the language's `@name`; those without a meaning lack."""
        tagged: dict[str, list[int]] = {}
        for iid in sorted(self.remarks):
            for tag in self.remarks[iid].tags:
                tagged.setdefault(tag, []).append(iid)
        nodes: dict[str, Node] = {
            tag: Ids(tuple((iid, iid) for iid in iids)) for tag, iids in tagged.items()
        }
        for name, saved in self.selections.items():
            nodes.pop(name, None)
            with suppress(ExpressionError):
                nodes[name] = parse(saved.expression)
        return nodes

    @cached_property
    def places(self) -> NDArray[np.intp]:
        """(n, 2) of the iids with a remark, ascending, and its place in the alphabet."""
        iids = sorted(self.remarks)
        words = [self.remarks[iid].text.casefold() for iid in iids]
        place = {text: at for at, text in enumerate(sorted(set(words)))}
        found = [(iid, place[text]) for iid, text in zip(iids, words, strict=True)]
        return np.array(found, dtype=np.intp).reshape(-1, 2)


class Notebook:
    """The notebook of one data set; `notes` is what was read last."""

    def __init__(
        self, dataset_hash: str, folder: Path | None = None, patient: bool = False
    ) -> None:
        """Raises RequestError for what is no hash, and for a damaged file; the `patient` notebook
        is empty until that is mended, and `trouble` says so.
        """
        self._hash = checked_hash(dataset_hash, "the data set's hash")
        self.path = (folder or own_folder()) / f"{dataset_hash[:16]}.json"
        self.notes, self.trouble = Notes(), ""
        try:
            self.notes = self._read()
        except RequestError as error:
            if not patient:
                raise
            self.trouble = f"{error}; until then nothing is saved or noted"

    def refresh(self) -> None:
        """Read what other sessions have written. Raises RequestError for a damaged file."""
        self.notes = self._read()

    def save(self, name: str, saved: SavedSelection) -> None:
        """Keep a selection under a name, in place of an earlier one."""
        name = checked(name, "name")

        def change(notes: Notes) -> Notes:
            if name in _needs(saved.expression, notes):
                raise RequestError(f"{at(name)} is part of this selection; choose another name")
            if any(name in remark.tags for remark in notes.remarks.values()):
                raise RequestError(f"{at(name)} is a tag already; choose another name")
            if name in notes.unread.selections:
                told = f"{self.path} holds an unreadable {at(name)}"
                raise RequestError(f"{told}; choose another name")
            return replace(notes, selections={**notes.selections, name: saved})

        self._change(change)

    def forget(self, name: str) -> None:
        """Drop a saved selection that no other one needs."""

        def change(notes: Notes) -> Notes:
            for other, saved in notes.selections.items():
                if other != name and name in _needs(saved.expression, notes):
                    raise RequestError(f"{at(name)} is part of {at(other)}: forget that one first")
            kept = {key: value for key, value in notes.selections.items() if key != name}
            return replace(notes, selections=kept)

        self._change(change)

    def note(self, iid: int, text: str) -> None:
        """What is to be remembered of an instance; an empty text removes it."""
        text = printable(" ".join(text.split())[:_MOST_TEXT])

        def change(notes: Notes) -> Notes:
            self._writable(notes, iid)
            return _remarked(notes, iid, note=text)

        self._change(change)

    def toggle_tag(self, iids: list[int], tag: str) -> bool:
        """Tag some instances, or take the tag off where all of them have it; True where tagged."""
        tag = checked(tag.lstrip("#"), "tag")
        tagged = True

        def change(notes: Notes) -> Notes:
            nonlocal tagged
            if tag in notes.selections:
                raise RequestError(f"{at(tag)} is a saved selection already; choose another tag")
            remarks = dict(notes.remarks)
            tagged = not all(tag in remarks.get(iid, Remark()).tags for iid in iids)
            for iid in iids:
                self._writable(notes, iid)
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

    def _writable(self, notes: Notes, iid: int) -> None:
        """RequestError where the file holds something else about an instance."""
        if str(iid) in notes.unread.remarks:
            raise RequestError(f"{self.path} holds an unreadable remark on {iid}: mend it there")

    def _change(self, change: Callable[[Notes], Notes]) -> None:
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            with file_lock(self.path, _PATIENCE):
                notes = change(self._read())
                write_file(self.path, self._written(notes))
        except OSError as error:
            raise RequestError(f"{self.path}: {error.strerror}") from error
        except RecursionError as error:
            raise RequestError(f"{self.path}: is nested too deeply; move it away") from error
        self.notes = notes

    def _written(self, notes: Notes) -> bytes:
        return notebook_schema.written(
            self._hash, notes.selections, notes.remarks, notes.history, notes.unread
        )

    def _read(self) -> Notes:
        try:
            content = json.loads(self._content())
        except FileNotFoundError:
            return Notes()
        except OSError as error:
            told = f"{self.path}: cannot be read ({error.strerror}); move it away"
            raise RequestError(told) from error
        except (ValueError, RecursionError) as error:
            told = f"{self.path}: is no JSON ({error}); mend it, or move it away"
            raise RequestError(told) from error
        if not notebook_schema.is_notebook(content, self._hash):
            raise RequestError(f"{self.path}: is no notebook of this data set; move it away")
        return Notes(*notebook_schema.read(content))

    def _content(self) -> str:
        """The file's text. Raises OSError, ValueError, and RequestError for other than a file."""
        if self.path.is_symlink():
            raise RequestError(f"{self.path}: is a symbolic link; move it away")
        descriptor = os.open(self.path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOFOLLOW)
        with os.fdopen(descriptor, "rb") as file:
            found = os.fstat(descriptor)
            if not stat.S_ISREG(found.st_mode):
                raise RequestError(f"{self.path}: is no regular file; move it away")
            if found.st_size > _MOST_BYTES:
                raise RequestError(
                    f"{self.path}: larger than {_MOST_BYTES // 2**20} MB; move it away"
                )
            return file.read(_MOST_BYTES).decode()


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


def at(name: str) -> str:
    """A saved name or a tag as it stands in an expression."""
    return f"@{quoted(name)}"


def _needs(expression: str, notes: Notes) -> set[str]:
    """The saved names that an expression is made of, directly or through others."""
    found: set[str] = set()
    try:
        waiting = [parse(expression)]
    except ExpressionError:
        return found
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
