"""Rendering of a report as one self-contained HTML page: one script, no external resource."""

from __future__ import annotations

from base64 import b64encode
from hashlib import sha256
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from s2rstore.security.printable_text import printable_lines
from s2rtui.canvas import DARK, THEMES, Theme
from s2rtui.export.report.report_model import Report

_DARK_MEDIA = "screen and (prefers-color-scheme: dark)"
_COLOURS = ("background", "text", "muted", "faint", "highlight", "sim", "real", "truth")
_FOLDER = Path(__file__).parent


def render_page(report: Report) -> str:
    """Return the HTML of a report; every text is escaped and printable."""
    environment = Environment(
        loader=FileSystemLoader(_FOLDER), autoescape=True, undefined=StrictUndefined,
        finalize=_printable, trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    template = environment.get_template("report.html")
    style = Markup(_style(report))
    script = (_FOLDER / "report.js").read_text(encoding="utf-8")
    digest = b64encode(sha256(script.encode()).digest()).decode()
    return template.render(
        report=report, dark_media=_DARK_MEDIA, style=style, script=Markup(script),
        script_hash=Markup(f"sha256-{digest}"),
    ).lstrip()  # fmt: skip


def _printable(value: Any) -> Any:
    return value if isinstance(value, Markup) else printable_lines(str(value))


def _style(report: Report) -> str:
    has_dark_figures = any(image.dark for image in report.images)
    theme = THEMES[report.theme]
    schemes = "light dark" if has_dark_figures else theme.name
    variables = f":root {{ color-scheme: {schemes}; {_variables(theme)} }}"
    if has_dark_figures:
        variables += f"\n@media {_DARK_MEDIA} {{ :root {{ {_variables(DARK)} }} }}"
    rules = (_FOLDER / "report.css").read_text(encoding="utf-8")
    return f"{variables}\n{rules}"


def _variables(theme: Theme) -> str:
    return " ".join(f"--{name}: #{bytes(getattr(theme, name)).hex()};" for name in _COLOURS)
