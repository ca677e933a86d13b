"""TOML and JSON from outside: nested, huge, doubled or no files at all."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from s2rstore.errors import RequestError
from s2rstore.files import input_files
from s2rtui.cli import main
from tests.hostile.inputs import deadline, s2r
from tests.support import pairs

DEEP_JSON = "[" * 100_000 + "]" * 100_000
DEEP_TOML = "a = " + "[" * 100_000 + "]" * 100_000
LONG_KEY = ".".join("a" * 20_000) + " = 1"


def header(folder: Path, text: str, suffix: str) -> tuple[Path, Path]:
    """A manifest and the header that is to be given with it."""
    path = folder / f"header{suffix}"
    path.write_text(text)
    return pairs.manifest(folder / "data", n=2), path


@pytest.mark.parametrize(
    ("suffix", "text", "word"),
    [
        (".json", DEEP_JSON, "nested too deeply"),
        (".toml", DEEP_TOML, "nested too deeply"),
        (".toml", LONG_KEY, "a key of more than"),
        (".toml", f"x = {{{LONG_KEY}}}", "a key of more than"),
        (".json", '{"name": "a", "name": "b"}', "duplicate key"),
        (".json", "1" * 10_000, "not valid JSON"),
        (".json", "[]", "expected a table, got a list"),
        (".toml", "# x\n" * (1 << 19), "at most"),
    ],
    ids=["deep json", "deep toml", "dotted", "inline", "twice", "digits", "list", "large"],
)
def test_a_header_is_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], suffix: str, text: str, word: str
) -> None:
    manifest, path = header(tmp_path, text, suffix)
    words = ["ingest", "csv", str(manifest), "--header", str(path), "--store", str(tmp_path / "s")]
    with deadline():
        assert main(words) == 2
    told = capsys.readouterr().err
    assert told.startswith(f"s2r: {path}")
    assert word in told
    assert len(told.splitlines()) == 1


def test_long_keys_take_neither_time_nor_memory(tmp_path: Path) -> None:
    manifest, path = header(tmp_path, LONG_KEY, ".toml")
    ended = s2r(
        tmp_path, "ingest", "csv", manifest, "--header", path, "--store", tmp_path / "s", seconds=30
    )
    ended.refused("a key of more than")


def test_a_pipe_as_any_document_is_refused(
    tmp_path: Path, tiny_store: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pipe = tmp_path / "pipe.json"
    os.mkfifo(pipe)
    manifest = pairs.manifest(tmp_path / "data", n=2)
    for words in (
        ("ingest", "csv", manifest, "--header", pipe, "--store", tmp_path / "s"),
        ("ingest", "csv", pipe, "--store", tmp_path / "s"),
        ("nightly", pipe),
        ("gap", tiny_store, "--golden", pipe),
        ("gap", tiny_store, "--reference", pipe),
        ("gap", tiny_store, "--features", pipe),
    ):
        with deadline():
            assert main([str(word) for word in words]) == 2
        assert f"{pipe}: a pipe, not a regular file" in capsys.readouterr().err


@pytest.mark.parametrize("option", ["--golden", "--reference", "--features"])
def test_nested_files_of_a_gap_are_refused(
    tmp_path: Path, tiny_store: Path, capsys: pytest.CaptureFixture[str], option: str
) -> None:
    path = tmp_path / "deep.json"
    path.write_text(DEEP_JSON)
    assert main(["gap", str(tiny_store), option, str(path)]) == 2
    told = capsys.readouterr().err
    assert str(path) in told
    assert len(told.splitlines()) == 1


def test_a_huge_sparse_file_is_refused_unread(tmp_path: Path) -> None:
    path = tmp_path / "huge.json"
    with path.open("wb") as file:
        file.truncate(1 << 40)
    with pytest.raises(RequestError, match="at most"):
        input_files.read_json(path)


@pytest.mark.parametrize("kind", ["pipe", "folder", "device", "socket"])
def test_only_regular_files_are_opened(tmp_path: Path, kind: str) -> None:
    import socket

    path = tmp_path / "x.json"
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    elif kind == "device":
        path.symlink_to("/dev/zero")
    else:
        socket.socket(socket.AF_UNIX).bind(str(path))
    with pytest.raises(RequestError, match=f"x.json: a {kind}, not a regular file"):
        input_files.read_json(path)


def test_dotted_numbers_and_texts_are_no_long_keys(tmp_path: Path) -> None:
    path = tmp_path / "x.toml"
    words = ", ".join("1.5" for _ in range(500))
    lines = "1.2.3\n" * 99
    dots = "a. b. " * 200
    path.write_text(f'x = [{words}]\ny = "{dots}"\nz."a.b".c = """\n{lines}"""\n')
    assert input_files.read_toml(path)["z"]["a.b"]["c"].startswith("1.2.3")
