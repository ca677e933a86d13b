"""MkDocs hook: write the reference pages from the program's registries and parsers."""

from __future__ import annotations

import argparse
import html
import re
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
for _folder in (ROOT / "tools", ROOT / "store", ROOT):
    if str(_folder) not in sys.path:
        sys.path.insert(0, str(_folder))


def cell(text: object) -> str:
    """Text for a cell of a Markdown table, with HTML escaped."""
    return html.escape(str(text), quote=False).replace("|", "\\|").replace("\n", " ")


def code(text: object) -> str:
    """Text as code in a cell of a Markdown table."""
    return f"<code>{html.escape(str(text)).replace('|', '&#124;')}</code>" if str(text) else ""


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Markdown table of cells that are Markdown already."""
    lines = [f"| {' | '.join(head)} |", f"|{'---|' * len(head)}"]
    lines += [f"| {' | '.join(row)} |" for row in rows]
    return "\n".join(lines) + "\n"


def first_paragraph(thing: object) -> str:
    """First paragraph of the docstring of an object's class, or of a function."""
    owner = thing if callable(thing) and hasattr(thing, "__name__") else type(thing)
    return " ".join((owner.__doc__ or "").strip().split("\n\n")[0].split())


def commands_page() -> str:
    """Every command with all its options, from the argparse parsers."""
    from s2rtui.cli.command_parser import COMMANDS, load_command

    parts = [
        "# Commands\n",
        "`s2r STORE.s2r` is short for `s2r tui STORE.s2r`. "
        "[Exit codes](exit-codes.md) are the same for every command. "
        "`--debug` shows a traceback instead of a one-line error.\n",
        table(
            ("command", "what it does"),
            ((f"[`{name}`](#s2r-{name})", cell(text)) for name, text in COMMANDS.items()),
        ),
    ]
    for name, text in COMMANDS.items():
        parser = argparse.ArgumentParser(prog=f"s2r {name}")
        load_command(name).add_arguments(parser)
        parts.append(f"## s2r {name} {{ #s2r-{name} }}\n")
        parts.append(f"{cell(text[:1].upper() + text[1:])}.\n")
        parts += _parser_parts(parser)
    return "\n".join(parts)


def _parser_parts(parser: argparse.ArgumentParser) -> list[str]:
    """Usage line and table of arguments of a parser and of its subcommands."""
    formatter = argparse.HelpFormatter(parser.prog, width=90)
    formatter.add_usage(parser.usage, parser._actions, parser._mutually_exclusive_groups)
    parts = [f"```text\n{formatter.format_help().strip()}\n```\n"]
    rows, nested = [], []
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            nested += list(dict.items(action.choices))
        elif action.help != argparse.SUPPRESS and not isinstance(action, argparse._HelpAction):
            rows.append((code(_invocation(action)), cell(_help_of(parser, action))))
    if rows:
        parts.append(table(("argument", "meaning"), rows))
    for name, subparser in nested:
        parts.append(f"### {parser.prog} {name}\n")
        parts += _parser_parts(subparser)
    return parts


def _invocation(action: argparse.Action) -> str:
    if not action.option_strings:
        return str(action.metavar or action.dest)
    names = ", ".join(action.option_strings)
    if action.nargs == 0:
        return names
    choices = "{" + ",".join(map(str, action.choices)) + "}" if action.choices else ""
    value = action.metavar or choices or action.dest.upper()
    return f"{names} {' '.join(value) if isinstance(value, tuple) else value}"


def _help_of(parser: argparse.ArgumentParser, action: argparse.Action) -> str:
    if not action.help:
        return ""
    formatter = argparse.HelpFormatter(parser.prog)
    return formatter._expand_help(action)


def keys_page() -> str:
    """Every key by group, from the action registry."""
    parts = [
        "# Keys\n",
        "Made from the registry that also makes the key map, the footer, the help screen (`?`) "
        "and the palette (ctrl+p). Some keys mean something else while a brush is active, in the "
        "list, or in the adjust view; the last column says when.\n",
    ]
    for title, rows in _key_groups():
        parts.append(f"## {title}\n")
        parts.append(
            table(
                ("key", "action", "when"),
                ((code(key), cell(text), cell(when)) for key, text, when in rows),
            )
        )
    return "\n".join(parts)


_SITUATIONS = {
    "always": "",
    "begun": "while something is unfinished",
    "still": "no brush active",
    "plain": "no brush, not in adjust",
    "brushing": "brush active",
    "list": "in the list",
    "adjust": "in the adjust view",
    "elsewhere": "not in list or adjust",
}


def _key_groups() -> list[tuple[str, list[tuple[str, str, str]]]]:
    """Pairs of a group's title and its (key, description, situation)."""
    from s2rtui.app.action import GROUPS
    from s2rtui.app.key_bindings import ACTIONS

    groups = []
    for group, title in GROUPS.items():
        rows = [
            (action.all_keys, action.description, _SITUATIONS.get(action.when, action.when))
            for action in ACTIONS
            if action.group == group and action.description
        ]
        groups.append((title, rows))
    return groups


def _question_sections() -> list[str]:
    """The questions of a user with the keys that answer them, one section each."""
    from s2rtui.app.screens.help_content import QUESTIONS

    parts = []
    for question in QUESTIONS:
        parts.append(f"<section><h3>{html.escape(question.text)}</h3><dl>")
        parts += [
            f"<dt>{html.escape(key)}</dt><dd>{html.escape(text)}</dd>"
            for key, text in question.entries
        ]
        parts.append("</dl></section>")
    return parts


def cheat_sheet_page() -> str:
    """The questions and all keys on one printable A4 page."""
    parts = [
        "---\nhide:\n  - navigation\n  - toc\n---\n",
        "# Cheat sheet of keys\n",
        '<p class="cheat-sheet-note">Print this page: it fits on one sheet of A4.</p>\n',
        '<div class="cheat-sheet">',
        *_question_sections(),
    ]
    for title, rows in _key_groups():
        parts.append(f"<section><h3>{html.escape(title)}</h3><dl>")
        parts += [
            f"<dt>{html.escape(key)}</dt><dd>{html.escape(text)}</dd>" for key, text, _ in rows
        ]
        parts.append("</dl></section>")
    parts.append("</div>")
    return "\n".join(parts)


def language_page() -> str:
    """The selection language: operators by hand, fields and functions from the registries."""
    from s2rstore.language import fields

    numeric = (
        (
            code(name),
            code(fields.with_unit(name)) if fields.with_unit(name) != name else "",
            cell(field.unit),
            cell(field.description),
        )
        for name, field in fields.NUMERIC.items()
    )
    text = ((code(name), cell(field.description)) for name, field in fields.TEXT.items())
    functions = ((code(name), cell(text)) for name, text in fields.FUNCTIONS.items())
    words = ((code(name), cell(text)) for name, text in fields.WORDS.items())
    return "\n".join(
        [
            (ROOT / "docs" / "reference" / "_language_head.md").read_text(encoding="utf-8"),
            "## Words\n",
            table(("word", "meaning"), words),
            "## Functions\n",
            table(("function", "meaning"), functions),
            "## Fields of numbers\n",
            table(("field", "also", "unit", "meaning"), numeric),
            "## Fields of names\n",
            table(("field", "meaning"), text),
        ]
    )


def names_page() -> str:
    """Names of columns with their units."""
    from s2rstore.language import fields

    renamed = [name for name in fields.NUMERIC if fields.with_unit(name) != name]
    numbers = (
        (
            code(name),
            code(fields.with_unit(name)),
            code(fields.NUMERIC[name].column),
            cell(fields.NUMERIC[name].description),
        )
        for name in renamed
    )
    return "\n".join(
        [
            "# Names and units\n",
            "The name of a column ends in the unit of its values: `_m` for metres, `_deg` for "
            "degrees, `_rad` for radians, `_s` for seconds. Headings are degrees in rows of "
            "`s2r query`, `s2r show` and exported selections, radians in the index and so in "
            "`s2r sql`. Columns without such an ending are names, counts, shares, ranks, scores, "
            "or coordinates of the UMAP.\n",
            "Expressions of the [selection language](selection-language.md) take fields with and "
            "without the unit: `real.error > 2` and `real.error_m > 2` are the same. `--columns` "
            "prints the names that it was given. Tables of the index other than `pair` keep their "
            "names; [their comments](index-schema.md) state the units.\n",
            "## Numbers of an instance\n",
            table(("field", "with its unit", "column of `pair`", "meaning"), numbers),
        ]
    )


def schema_page() -> str:
    """Tables and columns of the index and of the gap history."""
    from s2rstore.gap_history import reader as gap_history
    from s2rstore.index import pair_view, schema

    parts = [
        "# Index schema\n",
        "`CURRENT.json` names the index file of the published generation: a DuckDB file that any "
        "DuckDB from 1.4 on opens read-only. Every table and column carries the comment that is "
        "shown here. Angles are radians and lengths metres. SQL `NULL` stands for a missing "
        "value, never NaN.\n",
    ]
    parts += [_schema_table(described) for described in schema.TABLES]
    comments = pair_view.column_comments()
    parts += [
        "## pair (view)\n",
        "One row per run and instance: ground truth and both sides.\n",
        table(("column", "meaning"), ((code(name), cell(text)) for name, text in comments.items())),
        "# Gap history\n",
        "`history/gap.jsonl` in the store (or where `output.history` of the nightly "
        "configuration says): JSON lines, one record per measured night. `s2r nightly` writes "
        "it. A new measurement also holds its `report`, the JSON text of `s2r gap --json`; "
        "`crc32` is the checksum of what stands before it in the line.\n",
    ]
    for title, kind in (
        ("Record of a night", gap_history.Night),
        ("Element of `axes`", gap_history.AxisFigures),
        ("Element of `estimates`", gap_history.NightlyEstimate),
    ):
        rows = (
            (code(name), code(sql_type), cell(meaning))
            for name, sql_type, meaning in gap_history.record_fields(kind)
        )
        parts.append(f"## {title}\n\n{table(('field', 'type', 'meaning'), rows)}")
    return "\n".join(parts)


def _schema_table(described: Any) -> str:
    rows = (
        (code(column.name), code(column.type), cell(column.comment)) for column in described.columns
    )
    comment = cell(described.comment[:1].upper() + described.comment[1:])
    return f"## {described.name}\n\n{comment}.\n\n{table(('column', 'type', 'meaning'), rows)}"


def registries_page() -> str:
    """Views, heatmap kinds, adjustments, importers and the other registries."""
    from s2rstore.heatmap_kinds import heatmap_facts
    from s2rtools.adjustments import ADJUSTMENTS
    from s2rtools.datasets.importers import IMPORTERS
    from s2rtools.datasets.layouts import LAYOUTS
    from s2rtools.heatmaps import HEATMAP_KINDS
    from s2rtools.models import ARCHITECTURES
    from s2rtools.motion_logs.drives import READERS
    from s2rtools.synthetic_world.factors import FACTORS
    from s2rtools.sysid.simulators import SIMULATORS
    from s2rtools.training.recipes import RECIPES
    from s2rtools.translation import METHODS
    from s2rtools.translator_evaluation.measures import MEASURES
    from s2rtui.charts.registry import VIEWS

    views = (
        (code(view.key), code(view.name), code(", ".join(view.aliases)), cell(view.description))
        for view in VIEWS
    )
    kinds = (
        (code(name), cell(first_paragraph(kind)), cell(heatmap_facts(name).shows))
        for name, kind in HEATMAP_KINDS.items()
    )
    adjustments = (
        (
            code(name),
            f"{adjustment.lowest:g} .. {adjustment.highest:g}",
            f"{adjustment.neutral:g}",
            cell(adjustment.unit),
            cell(adjustment.description),
        )
        for name, adjustment in ADJUSTMENTS.items()
    )
    parts = [
        "# Views, heatmaps, adjustments, importers\n",
        "## Views\n",
        table(("key", "name", "also called", "what it shows"), views),
        "## Heatmap kinds\n",
        table(("kind", "what it is", "what it shows"), kinds),
        "## Adjustments\n",
        table(("name", "range", "neutral", "unit", "what it does"), adjustments),
    ]
    others: tuple[tuple[str, str, Mapping[str, Any]], ...] = (
        ("Importers", "`s2r ingest NAME ...`", IMPORTERS),
        (
            "Layouts of recordings",
            "`s2r ingest pairs --sim NAME:PATH ...`",
            dict(LAYOUTS),
        ),
        ("Architectures", "`s2r model add ... --arch NAME`", ARCHITECTURES),
        ("Training recipes", "`s2r train --recipe NAME`", RECIPES),
        ("Translation methods", "`s2r translate fit NAME ...`", METHODS),
        ("Factors of the demo world", "`s2r ingest world --factors NAME`", FACTORS),
        ("Simulators", "`s2r sysid --simulator NAME`", SIMULATORS),
    )
    for title, use, entries in others:
        parts += [f"## {title}\n", f"{use}\n"]
        parts.append(
            table(
                ("name", "what it is"),
                ((code(name), cell(_meaning(entry))) for name, entry in entries.items()),
            )
        )
    measures = (
        (code(name), cell(each.meaning), code(each.unit) if each.unit else "", each.better)
        for name, each in MEASURES.items()
    )
    parts += [
        "## Measures of translators\n",
        "Rows of `s2r translate report --json` and of table `translator_metric`.\n",
        table(("name", "what it is", "unit", "better"), measures),
    ]
    suffixes = ", ".join(code(suffix or "a folder (ROS 2 bag)") for suffix in READERS)
    parts += [
        "## Motion logs\n",
        f"Drives are read from files that end in {suffixes} (a ROS 2 bag).\n",
    ]
    return "\n".join(parts)


def _meaning(entry: object) -> str:
    """An entry's `description`, else the first paragraph of its docstring or module."""
    described = getattr(entry, "description", "")
    if isinstance(described, str) and described:
        return described
    return first_paragraph(entry)


def changelog_page() -> str:
    """The change log of the repository."""
    return (ROOT / "CHANGELOG.md").read_text(encoding="utf-8").replace("](docs/", "](")


def gallery_page() -> str:
    """A picture and a sentence of each view, from the registry; `update_gallery.py` draws them."""
    from s2rtui.charts.registry import VIEWS

    parts = [
        "# Gallery of views\n",
        "Every view of the application, on the demo store with the worst 15 % selected; `health` "
        "and `history` show a store with planted faults and one with invented nights. The key "
        "shows it, `V` lets it fill the screen, and [`s2r export`](how-to/figures-and-reports.md) "
        "draws it on paper.\n",
    ]
    for view in VIEWS:
        text = view.description.removeprefix(f"{view.name}: ")
        parts.append(f"## {view.name}\n")
        parts.append(f"{code(view.key)} · {cell(text[:1].upper() + text[1:])}.\n")
        parts.append(f"![The view {view.name}](assets/views/{view.name}.png){{ loading=lazy }}\n")
    return "\n".join(parts)


def glossary_page() -> str:
    """The glossary that the package ships, whose links are those of the site."""
    return (ROOT / "s2rtui" / "glossary.md").read_text(encoding="utf-8")


PAGES: dict[str, Callable[[], str]] = {
    "reference/commands.md": commands_page,
    "reference/keys.md": keys_page,
    "cheat-sheet.md": cheat_sheet_page,
    "reference/selection-language.md": language_page,
    "reference/names-and-units.md": names_page,
    "reference/index-schema.md": schema_page,
    "reference/registries.md": registries_page,
    "changelog.md": changelog_page,
    "glossary.md": glossary_page,
    "gallery.md": gallery_page,
}


def on_files(files: Any, config: Any) -> Any:
    """Add the generated pages and `llms.txt` to the site (an event of MkDocs)."""
    from mkdocs.structure.files import File

    for name, page in PAGES.items():
        files.append(File.generated(config, name, content=page()))
    text = llms_text(config.site_name, config.site_description, config.nav)
    files.append(File.generated(config, "llms.txt", content=text))
    return files


def llms_text(name: str, description: str, nav: Sequence[Any]) -> str:
    """The pages of the site with their first sentences, as https://llmstxt.org asks for."""
    lines = [f"# {name}", "", f"> {description}", ""]
    alone = [entry for entry in nav if not _is_section(entry)]
    for title, pages in [("Start", alone), *_sections(nav)]:
        lines += [f"## {title}", "", *(_listed(pages)), ""]
    return "\n".join(lines)


def _is_section(entry: Any) -> bool:
    return isinstance(entry, dict) and isinstance(next(iter(entry.values())), list)


def _sections(nav: Sequence[Any]) -> Iterable[tuple[str, Sequence[Any]]]:
    return [next(iter(entry.items())) for entry in nav if _is_section(entry)]


def _listed(pages: Sequence[Any]) -> Iterable[str]:
    for entry in pages:
        title, path = next(iter(entry.items())) if isinstance(entry, dict) else ("", entry)
        if isinstance(path, list):
            yield from _listed(path)
            continue
        is_generated = path in PAGES
        text = PAGES[path]() if is_generated else (ROOT / "docs" / path).read_text("utf-8")
        heading = re.search(r"^# (.+)$", text, re.MULTILINE)
        shown = title or (heading[1] if heading else path)
        yield f"- [{shown}]({Path(path).with_suffix('.html')}): {_first_sentence(text)}"


def _first_sentence(text: str) -> str:
    """The first sentence of a page outside of headings, blocks, tables and pictures."""
    bare = re.sub(r"```.*?```", "", text, flags=re.DOTALL)
    for part in bare.split("\n\n"):
        if part.strip() and part.strip()[0] not in "#|!<:-":
            plain = " ".join(re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", part).split())
            return re.split(r"(?<=[.:]) ", plain)[0].rstrip(":")
    return ""
