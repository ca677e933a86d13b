"""A report as one HTML page: no script, nothing from elsewhere, the images inside."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path

from s2rstore.security.printable_text import printable_lines
from s2rtui.canvas import DARK, LIGHT, Rgb, Theme
from s2rtui.export.report.content import (Example, Facts, Report, ReportImage, ReportTable, RunPart, Section,)

_DARK = "screen and (prefers-color-scheme: dark)"
_POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
_INKS = ("background", "text", "muted", "faint", "highlight", "sim", "real", "truth")


def page(report: Report) -> str:
    """The whole file."""
    dark = any(picture.dark for picture in report.pictures)
    body = [
        _header(report),
        _contents(report),
        "<main>",
        _front(report),
        *(_section(number, section) for number, section in enumerate(report.sections, 1)),
        "</main>",
    ]
    return "\n".join([_head(report.title, dark), "<body>", *body, "</body>", "</html>", ""])


def _head(title: str, dark: bool) -> str:
    style = Path(__file__).with_name("report.css").read_text(encoding="utf-8")
    schemes = "light dark" if dark else "light"
    inks = f":root {{ color-scheme: {schemes}; {_variables(LIGHT)} }}"
    if dark:
        inks += f"\n@media {_DARK} {{ :root {{ {_variables(DARK)} }} }}"
    return "\n".join(
        [
            "<!doctype html>",
            '<html lang="en">',
            "<head>",
            '<meta charset="utf-8">',
            f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f"<title>{_text(title)}</title>",
            f"<style>\n{inks}\n{style}</style>",
            "</head>",
        ]
    )


def _variables(theme: Theme) -> str:
    """The figures' own colours, so that page and figures share one ground."""
    return " ".join(f"--{name}: {_hex(getattr(theme, name))};" for name in _INKS)


def _hex(ink: Rgb) -> str:
    return "#" + "".join(f"{part:02x}" for part in ink)


def _text(text: str) -> str:
    """Text as text, in printable characters and lines."""
    return escape(printable_lines(text))


def _header(report: Report) -> str:
    subtitle = f'<p class="subtitle">{_text(report.subtitle)}</p>' if report.subtitle else ""
    return f"<header>\n<h1>{_text(report.title)}</h1>\n{subtitle}{_facts(report.facts)}\n</header>"


def _contents(report: Report) -> str:
    links = [
        f'<li><a href="#s{number}">{_text(section.title)}</a></li>'
        for number, section in enumerate(report.sections, 1)
    ]
    listed = "\n".join(['<li><a href="#front">All runs</a></li>', *links])
    return f'<nav aria-label="Contents">\n<ol>\n{listed}\n</ol>\n</nav>'


def _front(report: Report) -> str:
    told = "\n".join(f"<li>{_text(line)}</li>" for line in report.findings)
    return "\n".join(
        [
            '<section id="front">',
            "<h2>All runs</h2>",
            f'<ul class="findings">\n{told}\n</ul>',
            _table(report.runs),
            _pictures(report.pictures),
            "</section>",
        ]
    )


def _section(number: int, section: Section) -> str:
    parts = [f'<section id="s{number}">']
    code = f"<code>{_text(section.expression)}</code>"
    if section.title == section.expression:
        parts.append(f"<h2>{code}</h2>")
    else:
        parts += [f"<h2>{_text(section.title)}</h2>", f"<p>{code}</p>"]
    parts.append(_facts(section.facts))
    if section.problem:
        parts.append(f'<p class="problem">{_text(section.problem)}</p>')
    parts += [_table(table) for table in (section.runs, section.remarks) if table is not None]
    parts += [_part(part) for part in section.parts]
    return "\n".join([*parts, "</section>"])


def _part(part: RunPart) -> str:
    examples = [_example(example) for example in part.examples]
    return "\n".join(
        [
            f"<h3>Run {_text(part.run)}</h3>",
            f"<p>{_text(part.summary)}</p>",
            _table(part.table),
            _pictures(part.pictures),
            "<h4>The worst in reality</h4>",
            *examples,
        ]
    )


def _example(example: Example) -> str:
    tags = "".join(f'<li class="tag">#{_text(tag)}</li>' for tag in example.tags)
    tags = f'<ul class="tags" aria-label="Tags">{tags}</ul>' if tags else ""
    note = f"<blockquote>{_text(example.note)}</blockquote>" if example.note else ""
    images = "\n".join(_picture(image) for image in example.images)
    return "\n".join(
        [
            '<article class="example">',
            f"<h5>Instance {example.iid}</h5>",
            f"{tags}{note}",
            f'<div class="images">\n{images}\n</div>',
            _table(example.table),
            _facts(example.facts),
            "</article>",
        ]
    )


def _pictures(pictures: Sequence[ReportImage]) -> str:
    return '<div class="figures">\n' + "\n".join(map(_picture, pictures)) + "\n</div>"


def _picture(picture: ReportImage) -> str:
    width, height = picture.size
    shown = f'<img src="{picture.light}" width="{width}" height="{height}" '
    shown += f'alt="{_text(picture.alt)}">'
    if picture.dark:
        source = f'<source media="{_DARK}" srcset="{picture.dark}">'
        shown = f"<picture>{source}{shown}</picture>"
    numbers = ""
    if picture.numbers is not None:
        numbers = f"<details><summary>Numbers</summary>{_table(picture.numbers)}</details>"
    kind = ' class="wide"' if picture.wide else ""
    told = f"<figcaption>{_text(picture.caption)}</figcaption>" if picture.caption else ""
    return f"<figure{kind}>\n{shown}\n{told}{numbers}\n</figure>"


def _table(table: ReportTable) -> str:
    names = "".join(f'<th scope="col">{_text(name)}</th>' for name in table.names)
    rows = "\n".join(f"<tr>{_row(row)}</tr>" for row in table.rows)
    note = f'<p class="note">{_text(table.note)}</p>' if table.note else ""
    kind = ' class="texts"' if table.texts else ""
    return (
        f'<div class="table"><table{kind}>\n<caption>{_text(table.caption)}</caption>\n'
        f"<thead><tr>{names}</tr></thead>\n<tbody>\n{rows}\n</tbody>\n</table></div>{note}"
    )


def _row(cells: Iterable[str]) -> str:
    first, *others = cells
    kind = f' class="{first}"' if first in ("sim", "real", "truth") else ""
    head = f'<th scope="row"{kind}>{_text(first)}</th>'
    return head + "".join(f"<td>{_text(cell)}</td>" for cell in others)


def _facts(facts: Facts) -> str:
    if not facts:
        return ""
    told = "\n".join(f"<div><dt>{_text(k)}</dt><dd>{_text(v)}</dd></div>" for k, v in facts)
    return f"<dl>\n{told}\n</dl>"
