"""A night as one HTML page: no script, nothing from elsewhere, the plot inside."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from html import escape

from s2rstore.security.printable_text import printable
from s2rtools.nightly import night_status as c

_POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
_SIGNS = {"PASS": "●", "FAIL": "▲", "INCONCLUSIVE": "■", "ERROR": "▲", "SKIPPED": "·"}
_STYLE = """
:root { --ground: #fafaf8; --text: #1c212a; --muted: #626a78; --faint: #ced2d9; --soft: #e2e9f5;
  --PASS: #1d5fce; --FAIL: #d02c30; --ERROR: #d02c30; --INCONCLUSIVE: #8a6000; --SKIPPED: #626a78; }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 66rem; padding: 2rem 1.5rem 4rem; background: var(--ground);
  color: var(--text); font: 1rem/1.5 system-ui, "Segoe UI", "Noto Sans", "DejaVu Sans", sans-serif;
  font-variant-numeric: tabular-nums; }
h1 { margin: 0 0 .3rem; font-size: 2rem; line-height: 1.2; }
h2 { margin: 2.5rem 0 .6rem; padding-top: 1rem; border-top: 3px solid var(--faint); }
.lead { margin: 0 0 1rem; color: var(--muted); }
.verdict { display: inline-block; margin: .6rem 0; padding: .35rem .9rem; border-left: 5px solid;
  background: var(--soft); font-size: 1.3rem; font-weight: 700; }
.PASS { color: var(--PASS); } .FAIL { color: var(--FAIL); }
.ERROR { color: var(--ERROR); }
.INCONCLUSIVE { color: var(--INCONCLUSIVE); } .SKIPPED { color: var(--SKIPPED); }
td.word { font-weight: 600; white-space: nowrap; }
.table { overflow-x: auto; }
table { width: 100%; border-collapse: collapse; font-size: .93rem; }
th, td { padding: .35rem .9rem .35rem 0; text-align: left; vertical-align: baseline; }
thead th { border-bottom: 1.5px solid var(--muted); color: var(--muted); font-weight: 500; }
tbody tr + tr > * { border-top: 1px solid var(--faint); }
img { display: block; width: 100%; height: auto; border: 1px solid var(--faint); }
dl { display: flex; flex-wrap: wrap; gap: .4rem 2.2rem; }
dt { color: var(--muted); font-size: .8rem; } dd { margin: 0; overflow-wrap: anywhere; }
"""


def page(told: c.Content, picture: bytes) -> str:
    """The whole file; `picture` is a PNG."""
    night = told.night
    image = base64.b64encode(picture).decode()
    parts = [
        f'<h1>{_text(night.name)}</h1>\n<p class="lead">the gap of the night {night.night}</p>',
        f'<p class="verdict {_text(night.outcome)}">{_signed(night.outcome)}</p>',
        f"<p>{_text(told.checks[0].told)}</p>",
        f'<img src="data:image/png;base64,{image}" alt="{_text(_spoken(told))}">',
        "<h2>What was checked</h2>",
        _table(c.CHECKS, c.check_rows(told)),
    ]
    if night.estimates:
        names, rows = c.ESTIMATES, c.estimate_rows(told)
        parts += ["<h2>The simulator's parameters</h2>", _table(names, rows)]
    parts += ["<h2>Nights</h2>", _table(c.PAST, c.past_rows(told)), "<h2>About</h2>", _facts(told)]
    return "\n".join([_head(told.title), "<body>", "<main>", *parts, "</main>", "</body>",
                      "</html>", ""])  # fmt: skip


def _head(title: str) -> str:
    return "\n".join(
        [
            "<!doctype html>",
            '<html lang="en">',
            "<head>",
            '<meta charset="utf-8">',
            f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f"<title>{_text(title)}</title>",
            f"<style>{_STYLE}</style>",
            "</head>",
        ]
    )


def _spoken(told: c.Content) -> str:
    """The plot in words."""
    nights = [f"{night.night} {night.outcome}" for night in told.past[-7:]]
    return f"Gap over {len(told.past)} nights; the last ones: {', '.join(nights)}"


def _table(names: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    head = "".join(f'<th scope="col">{_text(name)}</th>' for name in names)
    body = "\n".join(f"<tr>{''.join(map(_cell, row))}</tr>" for row in rows)
    return (
        f'<div class="table"><table>\n<thead><tr>{head}</tr></thead>\n'
        f"<tbody>\n{body}\n</tbody>\n</table></div>"
    )


def _cell(value: str) -> str:
    if value in _SIGNS:
        return f'<td class="word {value}">{_signed(value)}</td>'
    return f"<td>{_text(value)}</td>"


def _signed(word: str) -> str:
    return f"{_SIGNS.get(word, '')} {_text(word)}"


def _facts(told: c.Content) -> str:
    rows = c.facts(told.night)
    parts = [f"<div><dt>{_text(k)}</dt><dd>{_text(v)}</dd></div>" for k, v in rows]
    return "<dl>\n" + "\n".join(parts) + "\n</dl>"


def _text(text: str) -> str:
    """Text as text, in printable characters."""
    return escape(printable(text))
