"""Hide shards of a store, and record which of its files a function reads."""

import io
import pickle
import shutil
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path

import pytest

from s2rstore.arrays.stored_array import METADATA
from s2rstore.errors import S2RError
from s2rstore.files import layout, safe_files
from s2rtui.cli import main

ARRAYS = (layout.FRAMES, layout.RUNS)
Function = Callable[[], object]


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a function gave: its result, or the exit code and the text of its error."""

    result: object = None
    code: int = 0
    error: str = ""


def shard_files(store: Path) -> list[str]:
    """The files that hold the values of all arrays, relative to the store."""
    return sorted(
        path.relative_to(store).as_posix()
        for folder in ARRAYS
        for path in (store / folder).rglob("*")
        if path.is_file() and path.name != METADATA and not path.name.startswith(".")
    )


def array_of(store: Path, shard: str) -> str:
    """The folder of the array that a shard belongs to, relative to the store."""
    folder = (store / shard).parent
    while not (folder / METADATA).is_file():
        folder = folder.parent
    return folder.relative_to(store).as_posix()


@contextmanager
def hidden(store: Path, shards: Iterable[str]) -> Iterator[None]:
    """Rename shards away, and back afterwards."""
    names = {name: store.parent / f"hidden-{number}" for number, name in enumerate(shards)}
    for name, place in names.items():
        (store / name).rename(place)
    try:
        yield
    finally:
        for name, place in names.items():
            place.replace(store / name)


@contextmanager
def files_read(store: Path) -> Iterator[set[str]]:
    """The files of a store, relative to it, that are opened for reading meanwhile."""
    names: set[str] = set()
    open_read = safe_files.open_read

    def recorded(root: Path, relative: str | Path) -> object:
        path = (root / relative).resolve()
        if path.is_relative_to(store.resolve()):
            names.add(path.relative_to(store.resolve()).as_posix())
        return open_read(root, relative)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(safe_files, "open_read", recorded)
        yield names


def linked_copy(store: Path, target: Path) -> Path:
    """A copy of a store whose arrays are hard links, so that they must not be written in place."""
    shutil.copytree(store, target, ignore=lambda folder, names: set(names) & set(ARRAYS))
    for folder in ARRAYS:
        shutil.copytree(store / folder, target / folder, copy_function=_link)
    return target


def _link(source: str, target: str) -> str:
    Path(target).hardlink_to(source)
    return target


def outcome(function: Function) -> Outcome:
    """Run a function; its error becomes the message and the exit code that a command gives."""
    try:
        result = function()
    except S2RError as error:
        return Outcome(None, error.exit_code, str(error))
    return result if isinstance(result, Outcome) else Outcome(pickle.dumps(result))


def command(store: Path, *words: str) -> Function:
    """Run `s2r`; `{store}` and `{out}` among its words are replaced.

    The result is the standard output and the content of the output file.
    """
    suffixes = {"export": ".png", "snapshot": ".txt", "report": ".html"}
    out = store.parent / f"output{suffixes.get(words[0], '')}"
    argv = [word.format(store=store, out=out) for word in words]

    def run() -> Outcome:
        text, errors = io.StringIO(), io.StringIO()
        with redirect_stdout(text), redirect_stderr(errors):
            code = main(argv)
        content = out.read_bytes() if out.exists() else b""
        out.unlink(missing_ok=True)
        if code:
            return Outcome(content or None, code, errors.getvalue() + text.getvalue())
        return Outcome((text.getvalue(), content))

    return run
