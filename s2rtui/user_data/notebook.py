"""Notebook of a user on one data set: saved selections, notes, tags, and the input history.

One JSON file per data set in the user data folder, never in the store. Every change reads the file
again under a lock, so that concurrent sessions keep each other's changes; entries that cannot be
read are preserved unchanged.
"""

from __future__ import annotations

import json
import os
import stat
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from s2rstore.errors import RequestError
from s2rstore.files.atomic_writes import write_file
from s2rstore.files.layout import checked_hash
from s2rstore.files.locks import file_lock
from s2rstore.language import ExpressionError, parse
from s2rstore.language.canonical_text import quoted
from s2rstore.language.syntax_tree import Ids, Like, Saved, leaves
from s2rstore.records import Part
from s2rstore.security.printable_text import printable
from s2rtui.user_data import notebook_schema, user_data_dir
from s2rtui.user_data.notebook_schema import (
    Notes,
    Remark,
    SavedSelection,
    part_label,
    valid_name,
    valid_tag,
)

__all__ = ["Notebook", "Notes", "ReadNotebook", "Remark", "SavedSelection", "valid_name"]

_MAX_HISTORY = 500
_MAX_NOTE_CHARACTERS = 2000
_MAX_FILE_BYTES = 32 * 2**20
"""Largest size of the file; 100,000 tagged instances take a fifth of it."""
_LOCK_SECONDS = 2.0
"""Longest wait for a change of another session."""


class Notebook:
    """The notebook of one store; `notes` is the content at the last reading."""

    def __init__(
        self,
        store_identity: str,
        folder: Path | None = None,
        tolerant: bool = False,
        parts: Sequence[Part] = (),
    ) -> None:
        """Read the notebook of a store from `folder` (default: the user data folder).

        `store_identity` is `Store.identity`, which stays the same when instances are appended.
        `parts` are the parts of the store, see `notes_for`.

        Raises RequestError for an invalid identity, and for a damaged file unless `tolerant`: then
        the notebook is empty, `error` has the message, and changes fail until the file is repaired.
        """
        self._identity = checked_hash(store_identity, "the identity of the store")
        self.path = (folder or user_data_dir()) / f"{store_identity[:16]}.json"
        self.notes, self.error = Notes(), ""
        self._parts = tuple(parts)
        try:
            self.notes = self._read(self._parts)
        except RequestError as error:
            if not tolerant:
                raise
            self.error = f"{error}; nothing can be saved until then"

    def notes_for(self, parts: Sequence[Part]) -> Notes:
        """Return the notes on a store of these parts. Copies of a store that were appended to
        differently share the notebook: what concerns instances of a part that this copy does not
        have is left out. Raises RequestError for a damaged file.
        """
        unchanged = tuple(parts) == self._parts or self.error
        return self.notes if unchanged else self._read(parts)

    def use_parts(self, parts: Sequence[Part]) -> None:
        """Set the parts of the store; see `notes_for`."""
        self.notes = self.notes_for(parts)
        self._parts = tuple(parts)

    def refresh(self) -> None:
        """Read the changes of other sessions. Raises RequestError for a damaged file."""
        self.notes = self._read(self._parts)

    def save(self, name: str, saved: SavedSelection) -> None:
        """Save a selection under a name; an earlier one of that name is replaced."""
        name = valid_name(name, "name")

        def change(notes: Notes) -> Notes:
            if name in _dependencies(saved.expression, notes):
                raise RequestError(
                    f"{reference(name)} is used by this selection; choose another name"
                )
            if any(name in remark.tags for remark in notes.remarks.values()):
                raise RequestError(f"{reference(name)} is a tag already; choose another name")
            if name in notes.unread.selections:
                raise RequestError(
                    f"{self.path} has an unreadable {reference(name)} "
                    f"({notes.unread.reasons.get(name)}); choose another name, or repair the file"
                )
            if name in notes.unread.foreign.get("selections", {}):
                raise RequestError(
                    f"{reference(name)} selects instances of another copy of this store; "
                    "choose another name"
                )
            labels = {
                part_label(part.first_iid, self._parts)
                for low, high in _named_iids(saved.expression, notes)
                for part in self._parts[1:]
                if low < part.stop and part.first_iid <= high
            }
            marked = replace(saved, parts=tuple(sorted(labels)))
            return replace(notes, selections={**notes.selections, name: marked})

        self._change(change)

    def forget(self, name: str) -> None:
        """Delete a saved selection that no other selection uses."""

        def change(notes: Notes) -> Notes:
            for other, saved in notes.selections.items():
                if other != name and name in _dependencies(saved.expression, notes):
                    raise RequestError(
                        f"{reference(name)} is used by {reference(other)}; forget that first"
                    )
            rest = {key: value for key, value in notes.selections.items() if key != name}
            return replace(notes, selections=rest)

        self._change(change)

    def note(self, iid: int, text: str) -> None:
        """Set the note of an instance; an empty text removes it."""

        def change(notes: Notes) -> Notes:
            self._check_readable(notes, iid)
            remark = replace(notes.remarks.get(iid, Remark()), note=_note_text(text))
            return _with_remarks(notes, {iid: remark})

        self._change(change)

    def add_remarks(self, remarks: Mapping[int, Remark]) -> int:
        """Add tags of instances to those that they have, and set the notes that are not empty.

        Returns the number of instances whose tags or note changed.
        """
        added = {iid: tuple(map(valid_tag, remark.tags)) for iid, remark in remarks.items()}
        count = 0

        def change(notes: Notes) -> Notes:
            nonlocal count
            changed = {}
            for iid, tags in added.items():
                _check_free(notes, tags)
                self._check_readable(notes, iid)
                before = notes.remarks.get(iid, Remark())
                note = _note_text(remarks[iid].note) or before.note
                after = Remark(tuple(dict.fromkeys((*before.tags, *tags))), note)
                if after != before:
                    changed[iid] = after
            count = len(changed)
            return _with_remarks(notes, changed)

        self._change(change)
        return count

    def toggle_tag(self, iids: list[int], tag: str) -> bool:
        """Tag instances, or remove the tag if all have it; return whether they are tagged."""
        tag = valid_tag(tag)
        tagged = True

        def change(notes: Notes) -> Notes:
            nonlocal tagged
            _check_free(notes, [tag])
            remarks = {iid: notes.remarks.get(iid, Remark()) for iid in iids}
            tagged = not all(tag in remark.tags for remark in remarks.values())
            for iid, remark in remarks.items():
                self._check_readable(notes, iid)
                others = tuple(other for other in remark.tags if other != tag)
                remarks[iid] = replace(remark, tags=(*others, tag) if tagged else others)
            return _with_remarks(notes, remarks)

        self._change(change)
        return tagged

    def add_history(self, expressions: tuple[str, ...]) -> None:
        """Append expressions to the history; earlier occurrences are removed."""

        def change(notes: Notes) -> Notes:
            newest = dict.fromkeys(reversed((*notes.history, *expressions)))
            return replace(notes, history=tuple(reversed(list(newest)[:_MAX_HISTORY])))

        self._change(change)

    def _check_readable(self, notes: Notes, iid: int) -> None:
        """Raise RequestError if the file has an unreadable remark on an instance."""
        key = str(iid)
        if key in notes.unread.remarks:
            raise RequestError(
                f"{self.path} has an unreadable remark on instance {iid} "
                f"({notes.unread.reasons.get(key)}); repair it there"
            )

    def _change(self, change: Callable[[Notes], Notes]) -> None:
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            with file_lock(self.path, _LOCK_SECONDS) as lease:
                notes = change(self._read(self._parts))
                content = notebook_schema.encode(self._identity, notes, self._parts)
                write_file(self.path, content, lease.check)
        except OSError as error:
            raise RequestError(f"{self.path}: {error.strerror}") from error
        except RecursionError as error:
            message = f"{self.path}: is nested too deeply; repair it, or move it away"
            raise RequestError(message) from error
        self.notes = notes

    def _read(self, parts: Sequence[Part]) -> Notes:
        try:
            content = json.loads(self._content())
        except FileNotFoundError:
            return Notes()
        except OSError as error:
            message = f"{self.path}: cannot be read ({error.strerror}); move it away"
            raise RequestError(message) from error
        except (ValueError, RecursionError) as error:
            message = f"{self.path}: is not JSON ({error}); repair it, or move it away"
            raise RequestError(message) from error
        if not notebook_schema.is_notebook(content, self._identity):
            raise RequestError(f"{self.path}: is not a notebook of this data set; move it away")
        return notebook_schema.decode(content, parts)

    def _content(self) -> str:
        """Return the text of the file. Raises OSError, ValueError, RequestError."""
        if self.path.is_symlink():
            raise RequestError(f"{self.path}: is a symbolic link; move it away")
        descriptor = os.open(self.path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOFOLLOW)
        with os.fdopen(descriptor, "rb") as file:
            status = os.fstat(descriptor)
            if not stat.S_ISREG(status.st_mode):
                raise RequestError(f"{self.path}: is not a regular file; move it away")
            if status.st_size > _MAX_FILE_BYTES:
                limit = _MAX_FILE_BYTES // 2**20
                raise RequestError(f"{self.path}: larger than {limit} MB; move it away")
            return file.read(_MAX_FILE_BYTES).decode()


class ReadNotebook(Notebook):
    """A read-only notebook, for commands and screenshots."""

    def _change(self, change: Callable[[Notes], Notes]) -> None:
        raise RequestError("this session is read-only: nothing is saved")


def reference(name: str) -> str:
    """Return a saved name or a tag in the syntax of the selection language."""
    return f"@{quoted(name)}"


def _dependencies(expression: str, notes: Notes) -> set[str]:
    """Return the saved names that an expression uses, directly or through others."""
    names: set[str] = set()
    try:
        pending = [parse(expression)]
    except ExpressionError:
        return names
    while pending:
        for leaf in leaves(pending.pop()):
            if isinstance(leaf, Saved) and leaf.name not in names:
                names.add(leaf.name)
                if leaf.name in notes.nodes:
                    pending.append(notes.nodes[leaf.name])
    return names


def _named_iids(expression: str, notes: Notes) -> set[tuple[int, int]]:
    """The closed ranges of the iids that an expression names itself or through saved selections.

    Tags are left out: they are looked up again in every copy of the store.
    """
    names = _dependencies(expression, notes) & notes.selections.keys()
    ranges: set[tuple[int, int]] = set()
    for text in (expression, *(notes.selections[name].expression for name in names)):
        with suppress(ExpressionError):
            for leaf in leaves(parse(text)):
                if isinstance(leaf, Ids):
                    ranges.update(leaf.ranges)
                elif isinstance(leaf, Like):
                    ranges.add((leaf.iid, leaf.iid))
    return ranges


def _note_text(text: str) -> str:
    return printable(" ".join(text.split())[:_MAX_NOTE_CHARACTERS])


def _check_free(notes: Notes, tags: Iterable[str]) -> None:
    """Raise RequestError where a tag is the name of a saved selection."""
    for tag in tags:
        if tag in notes.selections:
            raise RequestError(f"{reference(tag)} is a saved selection already; choose another tag")


def _with_remarks(notes: Notes, changed: Mapping[int, Remark]) -> Notes:
    """Return notes with some remarks replaced, and those that are empty removed."""
    remarks = {**notes.remarks, **changed}
    return replace(notes, remarks={iid: r for iid, r in remarks.items() if r != Remark()})
