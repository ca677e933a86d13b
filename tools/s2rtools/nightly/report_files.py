"""The reports of a night as files: HTML, Markdown and JUnit from one model, and its metrics.

The HTML page has no scripts and no external resources. In the JUnit file failures and errors fail a
build, and inconclusive checks are skipped. Metrics are in the OpenMetrics text format, all of them
gauges, with one gauge per outcome, so that Prometheus' textfile collector can read them; it does
not support state sets. Unknown values have no line.
"""

from __future__ import annotations

import base64
import datetime
import math
from collections.abc import Iterator, Mapping
from typing import Any
from xml.etree import ElementTree as ET

from jinja2 import Environment
from prometheus_client import CollectorRegistry
from prometheus_client.core import GaugeMetricFamily
from prometheus_client.openmetrics.exposition import generate_latest
from prometheus_client.registry import Collector

from s2rstore.gap_history.gate_status import EXIT_CODES, EXIT_CODES_TEXT
from s2rstore.gap_history.reader import BOUNDS, Night
from s2rstore.intervals import Interval
from s2rstore.security.printable_text import printable
from s2rtools.nightly.report_model import NightReport, Table, axis_check

_SIGNS = {"PASS": "●", "FAIL": "▲", "INCONCLUSIVE": "■", "ERROR": "▲", "SKIPPED": "·"}
_TEMPLATE = """\
<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; img-src data:; \
style-src 'unsafe-inline'">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{{ report.title }}</title>
<style>
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
td.outcome { font-weight: 600; white-space: nowrap; }
.table { overflow-x: auto; }
table { width: 100%; border-collapse: collapse; font-size: .93rem; }
th, td { padding: .35rem .9rem .35rem 0; text-align: left; vertical-align: baseline; }
thead th { border-bottom: 1.5px solid var(--muted); color: var(--muted); font-weight: 500; }
tbody tr + tr > * { border-top: 1px solid var(--faint); }
img { display: block; width: 100%; height: auto; border: 1px solid var(--faint); }
dl { display: flex; flex-wrap: wrap; gap: .4rem 2.2rem; }
dt { color: var(--muted); font-size: .8rem; } dd { margin: 0; overflow-wrap: anywhere; }
</style>
</head>
{%- macro table(columns, rows) %}
<div class="table"><table>
<thead><tr>{% for name in columns %}<th scope="col">{{ name }}</th>{% endfor %}</tr></thead>
<tbody>
{% for row in rows -%}
<tr>{% for value in row %}{% if value in signs -%}
<td class="outcome {{ value }}">{{ signs[value] }} {{ value }}</td>
{%- else -%}<td>{{ value }}</td>{% endif %}{% endfor %}</tr>
{% endfor -%}
</tbody>
</table></div>
{%- endmacro %}
<body>
<main>
<h1>{{ night.name }}</h1>
<p class="lead">the reality gap in the night {{ night.night }}</p>
<p class="verdict {{ night.outcome }}">{{ signs.get(night.outcome, "") }} {{ night.outcome }}</p>
<p>{{ report.checks[0].message }}</p>
<img src="data:image/png;base64,{{ plot }}" alt="Gap over {{ report.past | length }} nights; \
the last ones: {% for each in report.past[-7:] %}{{ each.night }} {{ each.outcome }}\
{% if not loop.last %}, {% endif %}{% endfor %}">
{%- for each in report.tables() %}
<h2>{{ each.title }}</h2>
{{- table(each.columns, each.rows) }}
{%- endfor %}
<h2>Measured data</h2>
<dl>
{% for name, value in report.facts() -%}
<div><dt>{{ name }}</dt><dd>{{ value }}</dd></div>
{% endfor -%}
</dl>
</main>
</body>
</html>
"""
HEADLINE = "headline"
Labels = tuple[str, ...]
_LABELS = ("nightly", "dataset", "run")
_ENDS = {"": "value", "_low": "low", "_high": "high"}


def html(report: NightReport, plot: bytes) -> str:
    """The page of a night; `plot` is a PNG."""
    environment = Environment(autoescape=True, finalize=_printable, keep_trailing_newline=True)
    return environment.from_string(_TEMPLATE).render(
        report=report,
        night=report.night,
        plot=base64.b64encode(plot).decode(),
        signs=_SIGNS,
    )


def _printable(value: object) -> object:
    """Escape control characters in texts; leave markup of macros as it is."""
    return printable(value) if type(value) is str else value


def markdown(report: NightReport) -> str:
    """The outcome, the checks, the estimated parameters and the past nights, for a chat."""
    checks, *tables = report.tables()
    parts = [
        f"# {_escaped(report.title)}",
        f"![Gap over time](history.png)\n\n{_escaped(report.checks[0].message)}",
        _markdown_table(checks),
    ]
    for table in tables:
        parts += [f"## {table.title}", _markdown_table(table)]
    parts.append("\n".join(f"- {name}: {_escaped(value)}" for name, value in report.facts()))
    return "\n\n".join(parts) + "\n"


def _markdown_table(table: Table) -> str:
    rows = [[_escaped(value) for value in row] for row in table.rows]
    lines = [table.columns, ["---"] * len(table.columns), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _escaped(text: str) -> str:
    """Printable text that cannot end a cell or start markup."""
    escaped = printable(text)
    for sign in "\\|<>*_`[]":
        escaped = escaped.replace(sign, f"\\{sign}")
    return escaped


def junit(report: NightReport) -> bytes:
    """The XML file, one test case per check."""
    night = report.night
    counts = {
        "tests": str(len(report.checks)),
        "failures": str(sum(check.outcome == "FAIL" for check in report.checks)),
        "errors": str(sum(check.outcome == "ERROR" for check in report.checks)),
        "skipped": str(
            sum(check.outcome in ("INCONCLUSIVE", "SKIPPED") for check in report.checks)
        ),
        "time": "0",
    }
    root = ET.Element("testsuites", {"name": "s2r nightly", **counts})
    stamp = night.written_at.removesuffix("Z")
    suite = ET.SubElement(
        root, "testsuite", {"name": printable(night.name), "timestamp": stamp, **counts}
    )
    properties = ET.SubElement(suite, "properties")
    for name, value in (("night", str(night.night)), *report.facts()):
        ET.SubElement(properties, "property", {"name": name, "value": printable(value)})
    for check in report.checks:
        case = ET.SubElement(
            suite, "testcase",
            {"classname": f"s2r.gap.{printable(night.run)}", "name": check.name, "time": "0"},
        )  # fmt: skip
        text = printable(check.message)
        if check.outcome == "FAIL":
            ET.SubElement(case, "failure", {"message": text, "type": "gap"}).text = text
        elif check.outcome == "ERROR":
            ET.SubElement(case, "error", {"message": text, "type": "request"}).text = text
        elif check.outcome == "PASS":
            ET.SubElement(case, "system-out").text = text
        else:
            lead = "inconclusive: " if check.outcome == "INCONCLUSIVE" else ""
            ET.SubElement(case, "skipped", {"message": f"{lead}{text}"})
    ET.indent(root)
    return ET.tostring(root, encoding="utf-8", xml_declaration=True) + b"\n"


def metrics(night: Night) -> bytes:
    """The whole file, ending in `# EOF`."""
    registry = CollectorRegistry()
    registry.register(_NightCollector(night))
    return generate_latest(registry)


class _NightCollector(Collector):
    """One night's gauges."""

    def __init__(self, night: Night) -> None:
        self._night = night

    def collect(self) -> Iterator[GaugeMetricFamily]:
        night = self._night
        gaps = {HEADLINE: night.gap} | {axis.axis: axis.gap for axis in night.axes}
        outcomes = {HEADLINE: night.headline, "all": night.outcome}
        outcomes |= {axis.axis: axis_check(axis, night.threshold).outcome for axis in night.axes}
        outcomes = {axis: outcome for axis, outcome in outcomes.items() if outcome in EXIT_CODES}
        yield from self._interval_gauges(
            "s2r_gap", "G; 0 is no gap, 100 the declared bad state",
            {(axis,): gap for axis, gap in gaps.items()}, ("axis",),
        )  # fmt: skip
        yield self._gauge("s2r_gap_threshold", "threshold of G", {(): night.threshold})
        yield self._gauge(
            "s2r_gap_outcome", "1 for the present outcome; axis `all` decides the exit code",
            {(axis, each): float(each == outcome)
             for axis, outcome in outcomes.items() for each in EXIT_CODES},
            ("axis", "outcome"),
        )  # fmt: skip
        yield self._gauge(
            "s2r_gap_exit_code", EXIT_CODES_TEXT,
            {(axis,): EXIT_CODES[outcome] for axis, outcome in outcomes.items()}, ("axis",),
        )  # fmt: skip
        yield from self._interval_gauges(
            "s2r_gap_measure", "the measure behind G, in its unit",
            {(a.axis, a.unit or ""): a.value for a in night.axes if a.state == "measured"},
            ("axis", "unit"),
        )  # fmt: skip
        yield from self._interval_gauges(
            "s2r_gap_golden_change_metres", "mean real error against the golden run",
            {(): night.golden_change},
        )  # fmt: skip
        yield from self._interval_gauges(
            "s2r_gap_estimate", "identified simulator parameter, or exchange rate",
            {(each.parameter, each.unit): each.value for each in night.estimates},
            ("parameter", "unit"),
        )  # fmt: skip
        since = datetime.datetime.combine(night.evidence_since, datetime.time(), datetime.UTC)
        written = datetime.datetime.fromisoformat(night.written_at)
        for name, text, value in (
            ("evidence_age_days", "age of the newest recordings in this night", night.evidence_age),
            ("evidence_since_timestamp_seconds", "first night with the newest recordings",
             since.timestamp()),
            ("evidence_limit_days", "age from which the evidence is stale", night.stale_after),
            ("stale", "1 where the evidence is too old", night.stale),
            ("computed_timestamp_seconds", "when this night was written", written.timestamp()),
        ):  # fmt: skip
            yield self._gauge(f"s2r_gap_{name}", text, {(): float(value)})

    def _gauge(
        self, name: str, text: str, samples: Mapping[Any, float], labels: Labels = ()
    ) -> GaugeMetricFamily:
        """A gauge with `samples` by the values of `labels`."""
        night = self._night
        family = GaugeMetricFamily(name, text, labels=(*_LABELS, *labels))
        for label, value in samples.items():
            if math.isfinite(value):
                family.add_metric((night.name, night.dataset, night.run, *label), float(value))
        return family

    def _interval_gauges(
        self, name: str, text: str, intervals: Mapping[Any, Interval], labels: Labels = ()
    ) -> Iterator[GaugeMetricFamily]:
        """Three gauges: an estimate and its bounds."""
        for end, part in _ENDS.items():
            samples = {label: getattr(interval, part) for label, interval in intervals.items()}
            yield self._gauge(f"{name}{end}", f"{text}{BOUNDS[end]}", samples, labels)
