"""A notebook's file: what an entry is, and how entries are read and written.

An entry that cannot be read is kept as it stands, and written back.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, TypeVar

from s2rstore.errors import RequestError
from s2rstore.security.printable_text import printable

VERSION = 1
_SECTIONS = ("selections", "remarks", "history")
K = TypeVar("K")
V = TypeVar("V")


@dataclass(frozen=True, slots=True)
class SavedSelection:
    """An expression with the generation and run that it was saved at, and its count there.

    `trajectories` are those that were in view; None means all of them.
    """

    expression: str
    generation: int
    run: str
    count: int
    trajectories: tuple[str, ...] | None = None


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


@dataclass(frozen=True, slots=True)
class Unread:
    """Entries of a file that mean nothing to this program, as they stand there.

    `others` are whole sections.
    """

    selections: Mapping[str, Any] = field(default_factory=dict)
    remarks: Mapping[str, Any] = field(default_factory=dict)
    others: Mapping[str, Any] = field(default_factory=dict)

    @property
    def count(self) -> int:
        return len(self.selections) + len(self.remarks) + len(self.others)


Pages = tuple[dict[str, SavedSelection], dict[int, Remark], tuple[str, ...], Unread]


def is_notebook(content: Any, dataset_hash: str) -> bool:
    """Whether parsed JSON is a notebook of a data set, in a version that can be written."""
    if not isinstance(content, dict):
        return False
    return content.get("version") == VERSION and content.get("dataset") == dataset_hash


def read(content: dict[str, Any]) -> Pages:
    """Selections, remarks, history, and what of the file is left as it is."""
    others = {key: content[key] for key in content if key not in ("version", "dataset", *_SECTIONS)}
    sections = {key: content.get(key, {}) for key in _SECTIONS[:2]}
    for key, section in sections.items():
        if not isinstance(section, dict):
            others[key], sections[key] = section, {}
    history = content.get("history", [])
    if not isinstance(history, list):
        others["history"], history = history, []
    selections, odd = _entries(sections["selections"], _selection)
    remarks, strange = _entries(sections["remarks"], _remark)
    unread = Unread(odd, strange, others)
    return selections, remarks, tuple(_expression(str(text)) for text in history), unread


def _entries(
    section: Mapping[str, Any], parsed: Callable[[str, Any], tuple[K, V]]
) -> tuple[dict[K, V], dict[str, Any]]:
    """The entries that can be read, and the rest as it stands."""
    known: dict[K, V] = {}
    rest: dict[str, Any] = {}
    for key, value in section.items():
        try:
            name, entry = parsed(key, value)
        except (KeyError, TypeError, ValueError, OverflowError, RequestError):
            rest[key] = value
        else:
            known[name] = entry
    return known, rest


def _selection(name: str, entry: Any) -> tuple[str, SavedSelection]:
    if checked(name, "name") != name:
        raise ValueError(name)
    view = entry.get("trajectories") if isinstance(entry, dict) else None
    found = SavedSelection(
        _expression(str(entry["expression"])), int(entry["generation"]),
        printable(str(entry["run"])), int(entry["count"]),
        None if view is None else tuple(printable(str(part)) for part in view),
    )  # fmt: skip
    return name, found


def _remark(iid: str, entry: Any) -> tuple[int, Remark]:
    if str(int(iid)) != iid or not 0 <= int(iid) < 2**31:
        raise ValueError(iid)
    if not isinstance(entry["tags"], list):
        raise TypeError(iid)
    tags = tuple(str(tag) for tag in entry["tags"])
    if any(checked(tag, "tag") != tag for tag in tags):
        raise ValueError(iid)
    return int(iid), Remark(tags, printable(str(entry["note"])))


def _expression(text: str) -> str:
    """An expression in printable characters, with the meaning that it has.

    What is escaped stands in quotation marks, where a backslash is written twice.
    """
    text = " ".join(text.splitlines()).replace("\t", " ") if not text.isprintable() else text
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else printable(c).replace("\\", "\\\\") for c in text)


def written(
    dataset_hash: str,
    selections: Mapping[str, SavedSelection],
    remarks: Mapping[int, Remark],
    history: tuple[str, ...],
    unread: Unread,
) -> bytes:
    """The file, with all that was left as it is."""
    content: dict[str, Any] = {
        "version": VERSION,
        "dataset": dataset_hash,
        "selections": {
            **unread.selections, **{name: asdict(saved) for name, saved in selections.items()}
        },
        "remarks": {
            **unread.remarks,
            **{
                str(iid): {"tags": list(remark.tags), "note": remark.note}
                for iid, remark in sorted(remarks.items())
            },
        },
        "history": list(history),
    }  # fmt: skip
    for key, value in unread.others.items():
        content[f"unread {key}" if key in _SECTIONS else key] = value
    return (json.dumps(content, indent=1, ensure_ascii=False) + "\n").encode()


def checked(name: str, what: str) -> str:
    """A name of a selection or a tag, without blanks around it. Raises RequestError."""
    name = name.strip().lstrip("@")
    if not name or len(name) > 60 or not name.isprintable() or '"' in name or "\\" in name:
        raise RequestError(f"{what}: 1 to 60 printable characters without quotes")
    return name
