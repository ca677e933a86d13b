"""Schema of the notebook file: decoding, encoding, and preservation of unreadable entries."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any, TypeVar

import msgspec

from s2rstore.errors import RequestError
from s2rstore.security.printable_text import printable

VERSION = 1
_SECTIONS = ("selections", "remarks", "history")
K = TypeVar("K")
V = TypeVar("V")


@dataclass(frozen=True, slots=True)
class SavedSelection:
    """An expression with the generation, run and number of instances at the time of saving.

    `trajectories` are the visible ones; None means all.
    """

    expression: str
    generation: int
    run: str
    count: int
    trajectories: tuple[str, ...] | None = None


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
    """

    selections: Mapping[str, Any] = field(default_factory=dict)
    remarks: Mapping[str, Any] = field(default_factory=dict)
    others: Mapping[str, Any] = field(default_factory=dict)
    reasons: Mapping[str, str] = field(default_factory=dict)

    @property
    def count(self) -> int:
        return len(self.selections) + len(self.remarks) + len(self.others)


Content = tuple[dict[str, SavedSelection], dict[int, Remark], tuple[str, ...], UnreadableEntries]


def is_notebook(content: Any, store_identity: str) -> bool:
    """Return whether parsed JSON is a notebook of a data set in the supported version."""
    found = (content.get("version"), content.get("dataset")) if isinstance(content, dict) else ()
    return found == (VERSION, store_identity)


def decode(content: dict[str, Any]) -> Content:
    """Return the selections, remarks and history of a file, and its unreadable entries."""
    others = {key: content[key] for key in content if key not in ("version", "dataset", *_SECTIONS)}
    sections = {key: content.get(key, {}) for key in _SECTIONS[:2]}
    for key, section in sections.items():
        if not isinstance(section, dict):
            others[key], sections[key] = section, {}
    history = content.get("history", [])
    if not isinstance(history, list):
        others["history"], history = history, []
    reasons: dict[str, str] = {}
    selections, other_selections = _entries(sections["selections"], _selection, reasons)
    remarks, other_remarks = _entries(sections["remarks"], _remark, reasons)
    unread = UnreadableEntries(other_selections, other_remarks, others, reasons)
    return selections, remarks, tuple(_expression(str(text)) for text in history), unread


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


def encode(
    store_identity: str,
    selections: Mapping[str, SavedSelection],
    remarks: Mapping[int, Remark],
    history: tuple[str, ...],
    unread: UnreadableEntries,
) -> bytes:
    """Return the content of the file, including the unreadable entries."""
    content: dict[str, Any] = {
        "version": VERSION,
        "dataset": store_identity,
        "selections": {
            **unread.selections, **{name: asdict(saved) for name, saved in selections.items()}
        },
        "remarks": {
            **unread.remarks,
            **{str(iid): asdict(remark) for iid, remark in sorted(remarks.items())},
        },
        "history": list(history),
    }  # fmt: skip
    for key, value in unread.others.items():
        content[f"unread {key}" if key in _SECTIONS else key] = value
    return (json.dumps(content, indent=1, ensure_ascii=False) + "\n").encode()


def valid_name(name: str, label: str) -> str:
    """Return a name of a selection or a tag without blanks at its ends. Raises RequestError."""
    name = name.strip().lstrip("@")
    if not name or len(name) > 60 or not name.isprintable() or '"' in name or "\\" in name:
        raise RequestError(f"{label}: must have 1 to 60 printable characters without quotes")
    return name
