"""Recursive selections, extreme expressions and invalid notebooks are rejected in one line."""

import contextlib
import json
import os
from pathlib import Path

import numpy as np
import pytest

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.files import layout
from s2rstore.language import ExpressionError, Node, evaluation, parse, to_text
from s2rstore.language.name_resolution import MAX_TERMS, expand
from s2rtui.app.pilot import settle
from s2rtui.cli import main
from s2rtui.user_data.notebook import Notebook
from tests.support import hostile
from tests.support.application import running

DEPTH = 3000
CHAINS = {
    "and": ("@s{next} & gap > {i}", "all"),
    "without": ("gap > {i} - @s{next}", "all"),
    "alias": ("@s{next}", "all"),
    "doubling": ("@s{next} & @s{next}", "all"),
    "circle": ("@s{next}", "@s0"),
}
EXTREME_EXPRESSIONS = {
    "parentheses": "(" * 100_000, "not": "!" * 100_000 + "all",
    "megabyte": "all & " * 200_000 + "all", "ids": "ids(" + "1," * 9000 + "1)",
    "exponent": "gap > 1e999", "huge iid": "ids(99999999999999999999)", "NUL": "all\x00",
    "name": "@" + "a" * 19_000,
}  # fmt: skip


def chain(kind: str, depth: int = DEPTH) -> dict[str, str]:
    """Expressions by name; the first is `s0`."""
    link, last = CHAINS[kind]
    links = {f"s{i}": link.format(i=i, next=i + 1) for i in range(depth)}
    return {**links, f"s{depth}": last}


@pytest.mark.parametrize("kind", CHAINS)
def test_a_query_of_chained_selections_is_rejected(tiny_store, user_data_folder, s2r, kind):
    entries = {name: hostile.saved_entry(text) for name, text in chain(kind).items()}
    hostile.notebook(user_data_folder, selections=entries)
    for arguments in (["@s0"], ["worst15 & !@s0"]) if kind == "and" else (["@s0"],):
        s2r("query", tiny_store, *arguments).assert_refused("@s0")


async def test_the_application_rejects_chained_selections(tiny_store, user_data_folder):
    entries = {name: hostile.saved_entry(text) for name, text in chain("doubling").items()}
    hostile.notebook(user_data_folder, selections=entries)
    async with running(tiny_store, size=(80, 24)) as (app, pilot):
        await pilot.press("slash", "ctrl+u", *"@s0", "enter")
        await settle(app, pilot)
        assert app.session.state.is_error
        assert "@s0" in app.session.state.message
        await pilot.press("escape", "f", "enter")
        await settle(app, pilot)
        await pilot.press("at", *"mine", "enter")
        await settle(app, pilot)
        assert app.fault is None
        assert app.is_running


def test_a_name_is_expanded_once(tiny_store):
    with s2rstore.open(tiny_store) as store:
        texts = {**chain("doubling", 8), "s8": "gap > 1"}
        saved: dict[str, Node] = {name: parse(text) for name, text in texts.items()}
        vocabulary = evaluation.vocabulary(store, saved)
        node = expand(parse("@s0"), vocabulary)
        assert getattr(node, "left", None) is getattr(node, "right", node)
        assert to_text(node).count("gap > 1") == 2**8


def test_large_expressions_are_evaluated_equally_by_numpy_and_sql(tiny_store):
    links = {f"s{i}": f"@s{i + 1} | ids({i % 40})" for i in range(95)}
    long = {f"t{i}": " | ".join(f"sim.error > {i}.{j:03d}" for j in range(MAX_TERMS // 6 - 10))
            for i in range(6)}  # fmt: skip
    right = {f"r{i}": f"ids({i % 40}, 39) - @r{i + 1}" for i in range(60)}
    texts = {**links, "s95": "none", **long, **right, "r60": "none"}
    with s2rstore.open(tiny_store) as store:
        saved: dict[str, Node] = {name: parse(text) for name, text in texts.items()}
        for expression in (
            "@s0",
            "@t0 & @t1 | @t2 | @t3 - @t4 | @t5",
            "@r0",
            "!@r0 - @s3",
            "!!!@s1",
        ):
            selected = np.flatnonzero(evaluation.select(store, expression, saved=saved))
            sql, parameters = evaluation.sql(store, expression, saved=saved)
            assert [row[0] for row in store.execute(sql, parameters)] == selected.tolist()


@pytest.mark.parametrize("name", EXTREME_EXPRESSIONS)
def test_extreme_expressions_give_one_line(tiny_store, capsys, name):
    assert main(["query", str(tiny_store), EXTREME_EXPRESSIONS[name]]) in (0, 2)
    output = capsys.readouterr()
    assert "fault" not in output.err
    assert output.err.count("\n") == 1
    assert len(output.err) < 2000


def test_nesting_of_negations_is_limited():
    assert parse(" & ".join(["!all"] * 150))
    with pytest.raises(ExpressionError, match="within each other"):
        parse("!" * 101 + "all")
    with pytest.raises(ExpressionError, match="within each other"):
        parse("!(" * 51 + "all" + ")" * 51)


# --- the notebook's file ---------------------------------------------------------------------


@pytest.mark.parametrize(
    "text",
    ["../../../../tmp/x", "/tmp/evil", "", "0" * 15, "0" * 65, "A" * 64, "g" * 64, "0" * 20 + "\n",
     "00000000/0000000", ".." * 8, None, 5],
)  # fmt: skip
def test_an_invalid_hash_is_rejected(user_data_folder, text):
    with pytest.raises(RequestError, match="hexadecimal"):
        layout.checked_hash(text, "hash")
    with pytest.raises(RequestError, match="hexadecimal"):
        Notebook(text)  # type: ignore[arg-type]
    with pytest.raises(RequestError, match="hexadecimal"):
        Notebook(text, tolerant=True)  # type: ignore[arg-type]
    assert layout.checked_hash("0123456789abcdef", "hash") == "0123456789abcdef"


def _link(path: Path) -> None:
    path.symlink_to("/etc/passwd")


def _huge(path: Path) -> None:
    with path.open("wb") as file:
        file.truncate(2**33)


def _nested(path: Path) -> None:
    path.write_text("[" * 200_000)


def _deep_rest(path: Path) -> None:
    depth = "[" * 900 + "]" * 900
    path.write_text(f'{{"version": 1, "dataset": "{"0" * 64}", "other": {depth}}}')


def _number(path: Path) -> None:
    path.write_text(f'{{"version": {"9" * 10_000}}}')


def _bytes(path: Path) -> None:
    path.write_bytes(b"\xff\xfe\x00")


def _odd(path: Path) -> None:
    remark = {"tags": ["a"], "note": "x"}
    remarks = {str(10**30): remark, "-1": remark, "٣": remark, "1": {"tags": "a", "note": 5}}
    content = {"version": 1, "dataset": "0" * 64, "remarks": remarks, "history": [None, {}],
               "selections": {"a": hostile.saved_entry("all", count=1e400), "b": None}}  # fmt: skip
    path.write_text(json.dumps(content))


@pytest.mark.parametrize(
    "make_file", [os.mkfifo, Path.mkdir, _link, _huge, _nested, _deep_rest, _number, _bytes, _odd]
)
def test_an_invalid_notebook_is_rejected(tiny_store, user_data_folder, capsys, make_file):
    user_data_folder.mkdir(parents=True)
    path = user_data_folder / f"{'0' * 16}.json"
    make_file(path)  # type: ignore[operator]
    code = main(["query", str(tiny_store), "all", "--count"])
    output = capsys.readouterr()
    assert code == (0 if make_file in (_deep_rest, _odd) else 2)
    assert output.err.count("\n") == code // 2
    tolerant = Notebook("0" * 64, tolerant=True)
    if make_file in (_odd, _deep_rest):
        with contextlib.suppress(
            RequestError
        ):  # unknown sections may be nested too deeply to be written
            tolerant.note(2, "seen\x1b[31m\u202e")
            assert Notebook("0" * 64).notes.remarks[2].note == "seen\\x1b[31m\\u202e"
    else:
        with pytest.raises(RequestError, match=path.name):
            tolerant.note(2, "seen")
    if make_file is _link:
        assert "root" in Path("/etc/passwd").read_text()
