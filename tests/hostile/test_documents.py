"""External TOML and JSON files that are deeply nested, huge, ambiguous or not regular files."""

import os

import pytest

from s2rstore.errors import RequestError
from s2rstore.files import documents
from tests.hostile.inputs import deadline
from tests.support import pairs

DEEP_JSON = "[" * 100_000 + "]" * 100_000
DEEP_TOML = "a = " + "[" * 100_000 + "]" * 100_000
LONG_KEY = ".".join("a" * 20_000) + " = 1"


@pytest.mark.parametrize(
    ("suffix", "text", "expected"),
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
def test_an_invalid_header_is_rejected_in_one_line(tmp_path, s2r, suffix, text, expected):
    path = tmp_path / f"header{suffix}"
    path.write_text(text)
    manifest = pairs.manifest(tmp_path / "data", n=2)
    with deadline():
        result = s2r("ingest", "csv", manifest, "--header", path, "--store", tmp_path / "s")
    result.assert_refused(f"s2r: {path}", expected)


def test_a_pipe_in_place_of_a_document_is_rejected(tmp_path, tiny_store, s2r):
    pipe = tmp_path / "pipe.json"
    os.mkfifo(pipe)
    manifest = pairs.manifest(tmp_path / "data", n=2)
    for arguments in (
        ("ingest", "csv", manifest, "--header", pipe, "--store", tmp_path / "s"),
        ("ingest", "csv", pipe, "--store", tmp_path / "s"),
        ("nightly", pipe),
        ("gap", tiny_store, "--golden", pipe),
        ("gap", tiny_store, "--reference", pipe),
    ):
        with deadline():
            s2r(*arguments).assert_refused(f"{pipe}: a pipe, not a regular file")


def test_a_huge_sparse_file_is_rejected_unread(tmp_path):
    path = tmp_path / "huge.json"
    with path.open("wb") as file:
        file.truncate(1 << 40)
    with pytest.raises(RequestError, match="at most"):
        documents.read_json(path)


@pytest.mark.parametrize("kind", ["pipe", "folder", "device", "socket"])
def test_only_regular_files_are_opened(tmp_path, kind):
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
        documents.read_json(path)


def test_dotted_numbers_and_strings_are_accepted(tmp_path):
    path = tmp_path / "x.toml"
    numbers = ", ".join("1.5" for _ in range(500))
    lines = "1.2.3\n" * 99
    dots = "a. b. " * 200
    path.write_text(f'x = [{numbers}]\ny = "{dots}"\nz."a.b".c = """\n{lines}"""\n')
    assert documents.read_toml(path)["z"]["a.b"]["c"].startswith("1.2.3")
