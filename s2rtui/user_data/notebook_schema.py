"""Schema of the notebook file: decoding, encoding, and preservation of unreadable entries."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import Any, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.language import ExpressionError, Node, parse
from s2rstore.language.syntax_tree import Ids
from s2rstore.records import Part
from s2rstore.security.printable_text import printable

VERSION = 1
_LABEL_HASH = 12
_SECTIONS = ("selections", "remarks", "history")
K = TypeVar("K")
V = TypeVar("V")


@dataclass(frozen=True, slots=True)
class SavedSelection:
    """An expression with the generation, run and number of instances at the time of saving.

    `trajectories` are the visible ones; None means all. `with_trained` says whether instances that
    the run's model was trained on were included. `parts` are the labels of the appended
    parts whose instances the expression names by iid; see `part_label`.
    """

    expression: str
    generation: int
    run: str
    count: int
    trajectories: tuple[str, ...] | None = None
    parts: tuple[str, ...] = ()
    with_trained: bool = False


@dataclass(frozen=True, slots=True)
class Remark:
    """Tags and note of one instance."""

    tags: tuple[str, ...] = ()
    note: str = ""

    @property
    def text(self) -> str:
        """One line such as `#door #dark: looks overexposed`."""
        tags = " ".join(f"#{tag}" for tag in self.tags)
        return ": ".join(part for part in (tags, self.note) if part)


@dataclass(frozen=True, slots=True)
class UnreadableEntries:
    """Entries of a file that do not match the schema, unchanged.

    `others` are whole sections; `reasons` has the error of each selection and remark by its key.
    `foreign` has the selections and remarks on instances that were appended to another copy of
    the store; they are no errors.
    """

    selections: Mapping[str, Any] = field(default_factory=dict)
    remarks: Mapping[str, Any] = field(default_factory=dict)
    others: Mapping[str, Any] = field(default_factory=dict)
    reasons: Mapping[str, str] = field(default_factory=dict)
    foreign: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    @property
    def count(self) -> int:
        return len(self.selections) + len(self.remarks) + len(self.others)


@dataclass(frozen=True)
class Notes:
    """Immutable content of a notebook; `unread` holds the entries that cannot be read."""

    selections: Mapping[str, SavedSelection] = field(default_factory=dict)
    remarks: Mapping[int, Remark] = field(default_factory=dict)
    history: tuple[str, ...] = ()
    unread: UnreadableEntries = field(default_factory=UnreadableEntries)

    @cached_property
    def nodes(self) -> dict[str, Node]:
        """Syntax trees of saved selections and tags by name, without unparsable expressions."""
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
    def remark_ranks(self) -> NDArray[np.intp]:
        """Array (n, 2) of the iids with a remark, ascending, and its alphabetical rank."""
        texts = {iid: self.remarks[iid].text.casefold() for iid in sorted(self.remarks)}
        ranks = {text: rank for rank, text in enumerate(sorted(set(texts.values())))}
        pairs = [(iid, ranks[text]) for iid, text in texts.items()]
        return np.array(pairs, dtype=np.intp).reshape(-1, 2)


def is_notebook(content: Any, store_identity: str) -> bool:
    """Return whether parsed JSON is a notebook of a data set in the supported version."""
    found = (content.get("version"), content.get("dataset")) if isinstance(content, dict) else ()
    return found == (VERSION, store_identity)


def part_label(iid: int, parts: Sequence[Part]) -> str:
    """The label of the appended part that holds an instance; empty for the first part.

    An iid means the same instance in all copies of a store whose part has this label.
    """
    part = next((part for part in parts[1:] if part.first_iid <= iid < part.stop), None)
    return "" if part is None else f"{part.first_iid}-{part.hash[:_LABEL_HASH]}"


def _remark_key(iid: int, parts: Sequence[Part]) -> str:
    """`57`, or `57@40-0123456789ab` for an instance of an appended part."""
    label = part_label(iid, parts)
    return f"{iid}@{label}" if label else str(iid)


def _without_foreign(
    sections: Mapping[str, Mapping[str, Any]], parts: Sequence[Part]
) -> tuple[dict[str, dict[str, Any]], dict[str, dict[str, Any]]]:
    """The entries of this store with plain iids as keys of remarks, and those of other copies."""
    own: dict[str, dict[str, Any]] = {"selections": {}, "remarks": {}}
    foreign: dict[str, dict[str, Any]] = {"selections": {}, "remarks": {}}
    for key, entry in sections["remarks"].items():
        number = key.partition("@")[0]
        is_number = number.isdecimal() and len(number) < 12 and str(int(number)) == number
        if not is_number or key == _remark_key(int(number), parts):
            own["remarks"][number if is_number else key] = entry
        else:
            foreign["remarks"][key] = entry
    labels = {part_label(part.first_iid, parts) for part in parts}
    for name, entry in sections["selections"].items():
        named = entry.get("parts") if isinstance(entry, dict) else None
        is_foreign = isinstance(named, list) and any(str(label) not in labels for label in named)
        (foreign if is_foreign else own)["selections"][name] = entry
    return own, foreign


def decode(content: dict[str, Any], parts: Sequence[Part] = ()) -> Notes:
    """Return the content of a file.

    `parts` are the parts of the store; without them, appended instances have no remarks.
    """
    others = {key: content[key] for key in content if key not in ("version", "dataset", *_SECTIONS)}
    sections = {key: content.get(key, {}) for key in _SECTIONS[:2]}
    for key, section in sections.items():
        if not isinstance(section, dict):
            others[key], sections[key] = section, {}
    history = content.get("history", [])
    if not isinstance(history, list):
        others["history"], history = history, []
    sections, foreign = _without_foreign(sections, parts)
    reasons: dict[str, str] = {}
    selections, other_selections = _entries(sections["selections"], _selection, reasons)
    remarks, other_remarks = _entries(sections["remarks"], _remark, reasons)
    unread = UnreadableEntries(other_selections, other_remarks, others, reasons, foreign)
    return Notes(selections, remarks, tuple(_expression(str(text)) for text in history), unread)


def _entries(
    section: Mapping[str, Any],
    decode_entry: Callable[[str, Any], tuple[K, V]],
    reasons: dict[str, str],
) -> tuple[dict[K, V], dict[str, Any]]:
    """Return the readable entries and the others; `reasons` receives the errors of the others."""
    readable: dict[K, V] = {}
    unreadable: dict[str, Any] = {}
    for key, value in section.items():
        try:
            name, entry = decode_entry(key, value)
        except (ValueError, RequestError) as error:
            unreadable[key], reasons[key] = value, printable(str(error))
        else:
            readable[name] = entry
    return readable, unreadable


def _selection(name: str, entry: Any) -> tuple[str, SavedSelection]:
    if valid_name(name, "name") != name:
        raise ValueError("name: blanks at its ends or a leading @ are not allowed")
    saved = msgspec.convert(entry, SavedSelection, strict=False)
    names = saved.trajectories
    return name, replace(
        saved,
        expression=_expression(saved.expression),
        run=printable(saved.run),
        trajectories=None if names is None else tuple(map(printable, names)),
    )


def _remark(key: str, entry: Any) -> tuple[int, Remark]:
    if not key.isdecimal() or str(int(key)) != key or int(key) >= 2**31:
        raise ValueError("key: must be the number of an instance")
    remark = msgspec.convert(entry, Remark, strict=False)
    if not {"tags", "note"} <= set(entry) or any(valid_name(t, "tag") != t for t in remark.tags):
        raise ValueError("must have a note, and tags without blanks at their ends")
    return int(key), replace(remark, note=printable(remark.note))


def _expression(text: str) -> str:
    """Return an expression in printable characters with the same meaning.

    Escaped characters occur within quotation marks, where a backslash is doubled.
    """
    text = " ".join(text.splitlines()).replace("\t", " ") if not text.isprintable() else text
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else printable(c).replace("\\", "\\\\") for c in text)


def encode(store_identity: str, notes: Notes, parts: Sequence[Part] = ()) -> bytes:
    """Return the content of the file, including the unreadable and the foreign entries."""
    unread = notes.unread
    foreign = unread.foreign
    content: dict[str, Any] = {
        "version": VERSION,
        "dataset": store_identity,
        "selections": {
            **foreign.get("selections", {}),
            **unread.selections,
            **{name: _selection_entry(saved) for name, saved in notes.selections.items()},
        },
        "remarks": {
            **foreign.get("remarks", {}),
            **unread.remarks,
            **{
                _remark_key(iid, parts): asdict(remark)
                for iid, remark in sorted(notes.remarks.items())
            },
        },
        "history": list(notes.history),
    }  # fmt: skip
    for key, value in unread.others.items():
        content[f"unread {key}" if key in _SECTIONS else key] = value
    return (json.dumps(content, indent=1, ensure_ascii=False) + "\n").encode()


def _selection_entry(saved: SavedSelection) -> dict[str, Any]:
    entry = asdict(saved)
    if not saved.parts:
        del entry["parts"]
    return entry


def valid_name(name: str, label: str) -> str:
    """Return a name of a selection or a tag without `@` before it and without blanks at its ends.

    Raises RequestError.
    """
    name = name.strip().lstrip("@ ")
    if not name or len(name) > 60 or not name.isprintable() or '"' in name or "\\" in name:
        raise RequestError(f"{label}: must have 1 to 60 printable characters without quotes")
    return name


def valid_tag(tag: str) -> str:
    """Return a tag without `#` or `@` before it and without blanks at its ends.

    Raises RequestError.
    """
    return valid_name(tag.strip().lstrip("#@ "), "tag")
