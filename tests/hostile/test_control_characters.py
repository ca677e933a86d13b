"""Control characters in external texts are escaped, except in CSV and JSON written to a pipe."""

import io
import sys
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from textual.screen import ModalScreen

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.language import complete, evaluation
from s2rstore.language.canonical_text import string
from s2rstore.security.printable_text import (
    printable,
    printable_lines,
    printable_stream,
    printable_values,
)
from s2rtui.app.app import S2RApp
from s2rtui.app.key_bindings import ACTIONS
from s2rtui.charts.registry import STORED, VIEWS
from s2rtui.cli import main
from tests.support import hostile
from tests.support.application import press, running
from tests.support.copies import copy_store
from tests.support.hostile import CLIPBOARD, HOSTILE, control_characters
from tests.support.terminals import open_application

FORBIDDEN = ("\x1b]52", "\x07", "\x9b", "\x85", "\u202e", "\u2066", "\u2028", "\x7f", "\x1b[31m")
"""Sequences that must never be written to a terminal."""
TABLES = (("runs",), ("verify",), ("query", "all", "--columns", "iid,room,traj"),
          ("sql", "SELECT room, what, value FROM room, provenance"),
          ("sql", f'SELECT 1 AS "{CLIPBOARD}", room AS "\u202e" FROM room'),
          *(("show", name) for name in STORED), *(("show", name, "--words") for name in STORED),
          ("gap",), ("doctor",))  # fmt: skip


def command(arguments: tuple[str, ...], store: Path) -> list[str]:
    """A command line on a store; `doctor` takes no store."""
    return (
        list(arguments) if arguments[0] == "doctor" else [arguments[0], str(store), *arguments[1:]]
    )


# --- the escaping functions ---------------------------------------------------------------------


@pytest.mark.parametrize(
    ("raw", "screen_text_of"),
    [
        ("plain [b] ünï ☃ 名", "plain [b] ünï ☃ 名"),
        ("\x1b]0;t\x07", "\\x1b]0;t\\x07"),
        ("\x9b31m", "\\x9b31m"),
        ("a\u202eb\u2066", "a\\u202eb\\u2066"),
        ("a\u2028b\x7f", "a\\u2028b\\x7f"),
        ("a\nb\tc\r", "a\\nb\\tc\\r"),
        ("\U000e0041\ud800", "\\U000e0041\\ud800"),
        ("\xa0", "\\xa0"),
    ],
)
def test_unprintable_characters_are_escaped(raw, screen_text_of):
    assert printable(raw) == screen_text_of
    assert printable(printable(raw)) == screen_text_of


def test_every_character_is_printable_or_escaped():
    all_characters = "".join(chr(code) for code in range(0x30000))
    assert printable(all_characters).isprintable()
    assert control_characters(printable_lines(all_characters)) == {"\t"}
    assert printable_values({"\x1b": ["\x9b", 1, None]}) == {"\\x1b": ["\\x9b", 1, None]}


def test_a_stream_escapes_its_text():
    underlying = io.StringIO()
    stream = printable_stream(underlying)
    print("a\x1b[31m\n\tb\u202e", file=stream)
    assert printable_stream(stream) is stream
    assert underlying.getvalue() == "a\\x1b[31m\n\tb\\u202e\n"


# --- reading -----------------------------------------------------------------------------------


def test_records_contain_no_control_characters(hostile_store):
    with s2rstore.open(hostile_store) as store:
        listed = [store.dataset, store.rooms, store.trajectories, store.domains, store.models,
                  store.runs, store.provenance("dataset"), store.instances.room_names,
                  *(store.array_kinds(run) for run in store.runs)]  # fmt: skip
        listed_text = repr(listed)
        assert "CLICK" in listed_text
        texts = [store.dataset.name, *store.instances.room_names, store.runs["vanilla"].created_at,
                 store.runs["vanilla"].sim_adjustments[0]["name"],
                 store.domains["sim"].sources["cameras"],
                 store.array_kinds("vanilla")[0].unit]  # fmt: skip
        values = [*store.provenance("dataset"), *store.provenance("dataset").values()]
    assert not control_characters("".join(texts))
    assert control_characters("".join(values)) <= {"\t"}


# --- inside the application ------------------------------------------------------------------


def screen_text_of(app: S2RApp) -> str:
    """All text of the screen; the escape codes must contain no forbidden sequence."""
    console = Console(file=io.StringIO(), force_terminal=True)
    strips = app.screen._compositor.render_strips()
    text = "".join(segment.text for strip in strips for segment in strip)
    codes = "".join(strip.render(console) for strip in strips)
    assert not any(raw in codes for raw in FORBIDDEN if raw != "\x1b[31m")
    return text


async def test_views_and_screens_show_no_control_characters_and_parse_no_markup(
    hostile_store, user_data_folder, tmp_path, no_foreign_markup
):
    entry = hostile.saved_entry(f'room:"{HOSTILE}"', run=HOSTILE, trajectories=[HOSTILE])
    names = ("mine", "[ @click=app.quit]CLICK", "[b")
    hostile.notebook(user_data_folder, selections=dict.fromkeys(names, entry), history=[HOSTILE],
                     remarks={"3": {"tags": ["[/", "CLICK"], "note": HOSTILE}})  # fmt: skip
    screen_text = ""
    async with running(hostile_store, folder=tmp_path, run="vanilla", size=(80, 24)) as (
        app,
        pilot,
    ):
        keys = [action.keys[0] for action in ACTIONS
                if action.name not in ("quit", "report", "adjust", "save_run")]  # fmt: skip
        views = [view.key for view in VIEWS if view.from_store]
        for key in [*keys, "N", *views, "ctrl+p", "slash"]:
            await press(app, pilot, key)
            screen_text += screen_text_of(app)
            assert app.fault is None, key
            assert app.is_running, key
            if key == "ctrl+p":
                await pilot.press(*"CLICK")
                await pilot.pause()
                screen_text += screen_text_of(app)
            if app.prompt.is_open:
                await pilot.press(*'room:"', "tab", "tab", "up", "up")
                await pilot.pause()
                screen_text += screen_text_of(app)
            while isinstance(app.screen, ModalScreen) or app.prompt.is_open:
                await pilot.press("escape")
        app.session.select(f"room:{string(HOSTILE + 'right')}")
        app.session.show_message(HOSTILE)
        app.updater.refresh()
        await pilot.pause()
        screen_text += screen_text_of(app)
        app.show_error(hostile.MARKUP)
        await pilot.pause()
        assert app.is_running
        assert app.fault is None
    assert not no_foreign_markup
    assert "\\x1b]52;c;" in screen_text
    assert not control_characters(screen_text)


async def test_pasted_text_is_escaped(hostile_store):
    from textual import events

    async with running(hostile_store, size=(120, 40)) as (app, pilot):
        await pilot.press("slash")
        app.post_message(events.Paste(f"worst15{CLIPBOARD}\u202e"))
        await pilot.pause()
        text = screen_text_of(app)
        assert "\\x1b]52" in text
        assert not control_characters(text)


def test_the_terminal_receives_no_forbidden_sequence(hostile_store, user_data_folder):
    entry = hostile.saved_entry(f'room:"{HOSTILE}"', run=HOSTILE)
    hostile.notebook(user_data_folder, selections={"mine": entry}, history=[HOSTILE])
    user_data_folder.joinpath("toured").touch()
    options = "--run", "vanilla"
    screen = open_application(hostile_store, user_data_folder.parent, *options, size=(150, 44))
    try:
        screen.wait_for("vanilla")
        screen.press("N")
        screen.wait_for("\\x1b]52;c;")
        screen.press("f")
        screen.wait_for("saved selections")
        screen.press(b"\x1b")
        screen.wait_for(lambda text: "saved selections" not in text)
        screen.press("/")
        screen.wait_for("complete")
        screen.press(b" & room:\t")
        screen.wait_for("\\x1b]52;c;")
        screen.press(b"\x1b")
        screen.wait_for(lambda text: "complete" not in text)
        screen.press("q")
        assert screen.wait_for_end() == 0
    finally:
        screen.close()
    raw = bytes(screen.raw)
    for text in (CLIPBOARD, "\x1b]52", "\x9b", "\u202e", "\u2066", "\u2028", "\x85"):
        assert text.encode() not in raw


# --- commands --------------------------------------------------------------------------------


@pytest.mark.parametrize("arguments", TABLES, ids=" ".join)
def test_tables_texts_and_errors_contain_no_control_characters(hostile_store, capsys, arguments):
    main(command(arguments, hostile_store))
    output = capsys.readouterr()
    assert output.out + output.err
    assert not control_characters(output.out.replace("\t", ""))
    assert not control_characters(output.err)


class Terminal(io.StringIO):
    """Standard output that claims to be a terminal."""

    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize("form", ["table", "csv", "json"])
@pytest.mark.parametrize("command_line", [("query", "all"), ("sql", "SELECT room FROM room")])
def test_every_format_is_escaped_on_a_terminal(hostile_store, monkeypatch, form, command_line):
    out = Terminal()
    monkeypatch.setattr(sys, "stdout", out)
    assert main([command_line[0], str(hostile_store), command_line[1], "--format", form]) == 0
    assert "1b]52;c;" in out.getvalue()
    assert control_characters(out.getvalue()) <= {"\t"}


def test_csv_and_json_in_a_pipe_contain_the_original_text(hostile_store, s2r):
    expression = f"room:{string(HOSTILE + 'right')}"
    for arguments in (("query", expression), ("query", "all", "--columns", "room")):
        command_line = [arguments[0], str(hostile_store), *arguments[1:]]
        rows = s2r(*command_line, "--format", "csv").rows
        assert f"{HOSTILE}right" in {row["room"] for row in rows}
        listed = s2r(*command_line, "--json").json
        assert f"{HOSTILE}right" in {row["room"] for row in listed}


@pytest.mark.parametrize(
    "arguments",
    [
        ("query", f"/none{HOSTILE}", "all"),
        ("query", "{store}", f'room:"{HOSTILE}"'),
        ("query", "{store}", "all", "--run", HOSTILE),
        ("query", "{store}", "all", "--columns", HOSTILE),
        ("query", "{store}", "all", f"--{HOSTILE}"),
        ("query", "{store}", "all", "--format", HOSTILE),
        ("query", "{store}", "all", "--format", "csv", "--out", f"/none/{HOSTILE}"),
        ("sql", "{store}", f"SELECT '{HOSTILE}"),
        ("show", "{store}", HOSTILE),
        ("export", "{store}", "--view", "rooms", "--out", f"/none/{HOSTILE}.png"),
        ("gap", "{store}", "--run", HOSTILE),
        ("tui", f"/none{HOSTILE}"),
        (f"{HOSTILE}",),
    ],
    ids=lambda arguments: " ".join(arguments)[:40],
)
def test_errors_are_one_line_without_control_characters(hostile_store, capsys, arguments):
    try:
        code = main([word.replace("{store}", str(hostile_store)) for word in arguments])
    except SystemExit as stopped:
        code = int(str(stopped.code))
    output = capsys.readouterr()
    assert code == 2, output
    assert not control_characters(output.err)
    assert output.err.count("\n") == 1, output.err


# --- identity --------------------------------------------------------------------------------


def test_displayed_room_names_can_be_used_in_expressions(hostile_store):
    with s2rstore.open(hostile_store) as store:
        arguments = evaluation.vocabulary(store)
        candidates = [text for text, _ in complete("room:", arguments)]
        assert len(candidates) == 2
        for text, stored in zip(candidates, store.stored_rooms.values(), strict=True):
            assert text.isprintable()
            for expression in (
                text,
                f"real.{text} | sim.{text}",
                f"room:{string(stored)}",
                f"!{text}",
            ):
                selected = np.flatnonzero(evaluation.select(store, expression))
                sql, parameters = evaluation.sql(store, expression)
                assert selected.size
                assert [row[0] for row in store.execute(sql, parameters)] == selected.tolist()


def test_names_with_equal_display_texts_are_rejected(store_copy, s2r):
    hostile.edit(store_copy, ("UPDATE room SET room = ? WHERE room = 'right'", ["a\x1b"]),
                 ("UPDATE room SET room = ? WHERE room <> ?", ["a\\x1b", "a\x1b"]))  # fmt: skip
    s2r("query", store_copy, "all").assert_refused("two rooms are both displayed as")
    with pytest.raises(RequestError, match="displayed as"):
        s2rstore.open(store_copy)


@pytest.mark.parametrize(
    ("table", "column"),
    [("run", "run"), ("model", "model"), ("domain", "domain"), ("dataset", "floor_plan"),
     ("zarr_array", "mode"), ("prediction", "split")],
)  # fmt: skip
def test_hostile_identifiers_are_rejected_or_escaped(tiny_store, tmp_path, capsys, table, column):
    store = copy_store(tiny_store, tmp_path / "bad.s2r")
    hostile.edit(store, (f'UPDATE "{table}" SET "{column}" = ?', [HOSTILE]))
    for arguments in (["query", "all"], ["show", "instance"], ["verify"]):
        code = main([arguments[0], str(store), *arguments[1:]])
        output = capsys.readouterr()
        assert code in (0, 1, 2), (arguments, output.err)
        assert not control_characters(output.out + output.err)


# --- files -----------------------------------------------------------------------------------


def test_figures_contain_no_control_characters(hostile_store, tmp_path, monkeypatch):
    from matplotlib.text import Text

    drawn_texts: list[str] = []
    original = Text.set_text

    def set_text(self: Text, text: object) -> None:
        drawn_texts.append(str(text))
        original(self, text)

    monkeypatch.setattr(Text, "set_text", set_text)
    for view in ("overview", "map", "rooms", "instance", "list", "history"):
        out = tmp_path / f"{view}.svg"
        arguments = ["export", str(hostile_store), "--view", view, "--run", "vanilla"]
        code = main([*arguments, "--room-names", "--select", "worst15", "--out", str(out)])
        assert code == 0 or view == "history"
    assert any("CLICK" in text for text in drawn_texts)
    assert not control_characters("".join(drawn_texts))


def test_a_report_contains_no_control_characters(hostile_store, tmp_path):
    out = tmp_path / "r.html"
    assert main(["report", str(hostile_store), "--run", "vanilla", "--select", "worst15",
                 "--title", HOSTILE, "--out", str(out)]) == 0  # fmt: skip
    text = out.read_text(encoding="utf-8")
    assert "CLICK" in text
    assert control_characters(text) <= {"\t"}
