"""The report of a night as one self-contained HTML page: no script, no external resource."""

from __future__ import annotations

import base64
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from s2rstore.security.printable_text import printable
from s2rtools.nightly import report_model

_SYMBOLS = {"PASS": "●", "FAIL": "▲", "INCONCLUSIVE": "■", "ERROR": "▲", "SKIPPED": "·"}
_NIGHTS_IN_ALT_TEXT = 7


def page(model: report_model.Content, plot: bytes) -> str:
    """Return the HTML of a night; `plot` is a PNG, and every text is escaped and printable."""
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent), autoescape=True,
        undefined=StrictUndefined, finalize=_printable, trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    newest = [f"{night.night} {night.outcome}" for night in model.past[-_NIGHTS_IN_ALT_TEXT:]]
    html = environment.get_template("html_report.html").render(
        model=model,
        symbols=_SYMBOLS,
        summary=model.checks[0].told,
        image=base64.b64encode(plot).decode(),
        alt=f"Gap over {len(model.past)} nights; the last ones: {', '.join(newest)}",
        checks=(report_model.CHECKS, report_model.check_rows(model)),
        estimates=model.night.estimates
        and (report_model.ESTIMATES, report_model.estimate_rows(model)),
        nights=(report_model.PAST, report_model.past_rows(model)),
        facts=report_model.facts(model.night),
    )
    return html.lstrip()


def _printable(value: Any) -> Any:
    return value if isinstance(value, Markup) else printable(str(value))
