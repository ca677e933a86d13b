"""Saved selections that refer to each other, deep and large expressions, and notebooks that are not
what they should be: one line, soon.
"""

from __future__ import annotations

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
from s2rtui.app.app import S2RApp
from s2rtui.app.pilot import settle
from s2rtui.canvas import RenderOptions
from s2rtui.cli import main
from s2rtui.session import Session
from s2rtui.user_data.notebook import Notebook
from tests.support import hostile

DEEP = 3000
CHAINS = {
    "and": ("@s{next} & gap > {i}", "all"),
    "without": ("gap > {i} - @s{next}", "all"),
    "not": ("!@s{next}", "all"),
    "alias": ("@s{next}", "all"),
    "doubling": ("@s{next} & @s{next}", "all"),
    "doubling or": ("gap > {i} | @s{next} - @s{next}", "worst15"),
    "circle": ("@s{next}", "@s0"),
}
NESTED = {
    "parentheses": "(" * 100_000,
    "balanced": "(" * 5000 + "all" + ")" * 5000,
    "not": "!" * 100_000 + "all",
    "megabyte": "all & " * 200_000 + "all",
    "ids": "ids(" + "1," * 9000 + "1)",
    "digits": "ids(" + "9" * 15_000 + ")",
    "exponent": "gap > 1e999",
    "huge iid": "ids(99999999999999999999)",
    "huge worst": "worst(1e300)",
    "NUL": "all\x00",
    "name": "@" + "a" * 19_000,
}


def chain(kind: str, deep: int = DEEP) -> dict[str, str]:
    """Expressions by name; the first is `s0`."""
    link, last = CHAINS[kind]
    made = {f"s{i}": link.format(i=i, next=i + 1) for i in range(deep)}
    return {**made, f"s{deep}": last}


@pytest.mark.parametrize("kind", CHAINS)
def test_of_a_query(
    tiny_store: Path, user_data_folder: Path, capsys: pytest.CaptureFixture[str], kind: str
) -> None:
    made = {name: hostile.saved_entry(text) for name, text in chain(kind).items()}
    hostile.notebook(user_data_folder, selections=made)
    for words in (["@s0"], ["@s0", "--count"], ["worst15 & !@s0"]):
        assert main(["query", str(tiny_store), *words]) == 2
        told = capsys.readouterr().err
        assert "@s0" in told
        assert told.count("\n") == 1


@pytest.mark.parametrize("kind", CHAINS)
async def test_inside_the_application(tiny_store: Path, user_data_folder: Path, kind: str) -> None:
    made = {name: hostile.saved_entry(text) for name, text in chain(kind).items()}
    hostile.notebook(user_data_folder, selections=made)
    app = S2RApp(Session(tiny_store, notebooks=Notebook), RenderOptions())
    app.load_scheduler.debounce_seconds = 0.001
    async with app.run_test(size=(160, 40)) as pilot:
        await settle(app, pilot)
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


def test_a_name_is_expanded_once(tiny_store: Path) -> None:
    with s2rstore.open(tiny_store) as store:
        texts = {**chain("doubling", 8), "s8": "gap > 1"}
        saved: dict[str, Node] = {name: parse(text) for name, text in texts.items()}
        words = evaluation.vocabulary(store, saved)
        node = expand(parse("@s0"), words)
        assert getattr(node, "left", None) is getattr(node, "right", node)
        assert to_text(node).count("gap > 1") == 2**8


def test_expressions_up_to_the_limits_are_evaluated_alike(tiny_store: Path) -> None:
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
            chosen = np.flatnonzero(evaluation.select(store, expression, saved=saved))
            sql, parameters = evaluation.sql(store, expression, saved=saved)
            assert [row[0] for row in store.execute(sql, parameters)] == chosen.tolist()


@pytest.mark.parametrize("name", NESTED)
def test_expressions_that_no_person_writes(
    tiny_store: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    assert main(["query", str(tiny_store), NESTED[name]]) in (0, 2)
    told = capsys.readouterr()
    assert "fault" not in told.err
    assert told.err.count("\n") == 1
    assert len(told.err) < 2000


def test_negated_terms_are_not_nested() -> None:
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
def test_a_hash_is_a_hash(user_data_folder: Path, text: object) -> None:
    with pytest.raises(RequestError, match="hexadecimal"):
        layout.checked_hash(text, "hash")
    with pytest.raises(RequestError, match="hexadecimal"):
        Notebook(text)  # type: ignore[arg-type]
    with pytest.raises(RequestError, match="hexadecimal"):
        Notebook(text, tolerant=True)  # type: ignore[arg-type]
    assert layout.checked_hash("0123456789abcdef", "hash") == "0123456789abcdef"


def test_a_store_whose_hash_is_a_path(
    store_copy: Path, user_data_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    hostile.edit(store_copy, ("UPDATE dataset SET hash = '../../../x'", []))
    assert main(["query", str(store_copy), "all"]) == 2
    assert "hexadecimal" in capsys.readouterr().err
    with pytest.raises(RequestError, match="hexadecimal"):
        Session(store_copy, notebooks=Notebook)
    assert not list(tmp_path.glob("x*"))


def _fifo(path: Path) -> None:
    os.mkfifo(path)


def _folder(path: Path) -> None:
    path.mkdir()


def _link(path: Path) -> None:
    path.symlink_to("/etc/passwd")


def _dangling(path: Path) -> None:
    path.symlink_to("/none/there")


def _loop(path: Path) -> None:
    path.symlink_to(path)


def _huge(path: Path) -> None:
    with path.open("wb") as file:
        file.truncate(2**33)


def _nested(path: Path) -> None:
    path.write_text("[" * 200_000)


def _deep_rest(path: Path) -> None:
    deep = "[" * 900 + "]" * 900
    path.write_text(f'{{"version": 1, "dataset": "{"0" * 64}", "other": {deep}}}')


def _number(path: Path) -> None:
    path.write_text(f'{{"version": {"9" * 10_000}}}')


def _bytes(path: Path) -> None:
    path.write_bytes(b"\xff\xfe\x00")


def _odd(path: Path) -> None:
    huge = {"tags": ["a"], "note": "x"}
    remarks = {str(10**30): huge, "-1": huge, "٣": huge, "1": {"tags": "a", "note": 5}}
    content = {"version": 1, "dataset": "0" * 64, "remarks": remarks, "history": [None, {}],
               "selections": {"a": hostile.saved_entry("all", count=1e400), "b": None}}  # fmt: skip
    path.write_text(json.dumps(content))


@pytest.mark.parametrize(
    "make",
    [_fifo, _folder, _link, _dangling, _loop, _huge, _nested, _deep_rest, _number, _bytes, _odd],
)
def test_a_notebook_that_is_none(
    tiny_store: Path, user_data_folder: Path, capsys: pytest.CaptureFixture[str], make: object
) -> None:
    user_data_folder.mkdir(parents=True)
    path = user_data_folder / f"{'0' * 16}.json"
    make(path)  # type: ignore[operator]
    code = main(["query", str(tiny_store), "all", "--count"])
    told = capsys.readouterr()
    assert code == (0 if make in (_deep_rest, _odd) else 2)
    assert told.err.count("\n") == code // 2
    patient = Notebook("0" * 64, tolerant=True)
    if make in (_odd, _deep_rest):
        with contextlib.suppress(RequestError):  # a rest that is nested too deeply to be written
            patient.note(2, "seen\x1b[31m\u202e")
            assert Notebook("0" * 64).notes.remarks[2].note == "seen\\x1b[31m\\u202e"
    else:
        with pytest.raises(RequestError, match=path.name):
            patient.note(2, "seen")
    if make is _link:
        assert "root" in Path("/etc/passwd").read_text()
