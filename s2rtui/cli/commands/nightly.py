"""`s2r nightly`: the gap of one night, kept in a history and told in files."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import datetime

    from s2rtools.nightly.config import NightlyConfig
    from s2rtools.nightly.run import NightRun


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("config", type=Path, metavar="CONFIG.toml")
    parser.add_argument("--night", metavar="YYYY-MM-DD", help="default: today, UTC")
    parser.add_argument(
        "--far-night", action="store_true",
        help="accept a date far from the newest night: over a month before it, or a year after it",
    )  # fmt: skip
    parser.add_argument(
        "--withdraw", metavar="YYYY-MM-DD",
        help="measure nothing; take a night back, which stays in the history's table `withdrawn`",
    )  # fmt: skip
    parser.add_argument("--json", action="store_true")


def execute(options: argparse.Namespace) -> int:
    from s2rtools.nightly import config as configs
    from s2rtools.nightly.run import nightly

    config = configs.read(options.config)
    if options.withdraw is not None:
        return _withdraw(config, options)
    done = nightly(config, _night(options.night), far=options.far_night)
    if options.json:
        print(json.dumps(_facts(config, done), indent=1, sort_keys=True))
    else:
        _tell(config, done)
    if done.night.refused:
        print(f"s2r: {done.night.reason}", file=sys.stderr)
    return done.night.exit_code


def _night(text: str | None) -> datetime.date:
    import datetime

    from s2rstore.errors import RequestError

    today = datetime.datetime.now(datetime.UTC).date()
    if text is None:
        return today
    night = _date("--night", text)
    if night > today + datetime.timedelta(days=7):
        raise RequestError(f"--night {text}: later than a week from today, {today}")
    return night


def _date(option: str, text: str) -> datetime.date:
    import datetime

    from s2rstore.errors import RequestError

    try:
        return datetime.date.fromisoformat(text)
    except ValueError as error:
        raise RequestError(f"{option} {text}: a date such as 2026-11-21") from error


def _withdraw(config: NightlyConfig, options: argparse.Namespace) -> int:
    from s2rstore.errors import RequestError
    from s2rtools.nightly.withdraw import withdraw

    if options.night is not None:
        raise RequestError("--withdraw measures nothing; leave out --night")
    night = _date("--withdraw", options.withdraw)
    gone = withdraw(config, night)
    if options.json:
        rows = [each.id for each in gone]
        facts = {"name": config.name, "withdrawn": str(night), "rows": rows}
        print(json.dumps({**facts, "history": str(config.history)}, indent=1, sort_keys=True))
    else:
        print(f"{night}: withdrawn from {config.name}; kept in table `withdrawn` of "
              f"{config.history}; its reports stay in {config.reports / str(night)}")  # fmt: skip
    return 0


def _tell(config: NightlyConfig, done: NightRun) -> None:
    from s2rtools.nightly.report_model import checks

    night = done.night
    for check in checks(night):
        print(f"{check.outcome:<12}  {check.name}: {check.message}")
    print(f"\n{night.night}: {night.outcome}; reports in {config.reports / str(night.night)}")
    if not done.new:
        print("nothing new", file=sys.stderr)
    elif not done.computed:
        print("nothing new was recorded: the figures are those of an earlier night",
              file=sys.stderr)  # fmt: skip


def _facts(config: NightlyConfig, done: NightRun) -> dict[str, object]:
    from s2rtools.gap.report import plain

    night = done.night
    facts = {
        "name": night.name, "night": str(night.night), "run": night.run, "key": night.key,
        "outcome": night.outcome, "exit_code": night.exit_code, "worst": night.worst,
        "gap": night.gap.value, "gap_low": night.gap.low, "gap_high": night.gap.high,
        "threshold": night.threshold, "reason": night.reason, "golden": night.golden,
        "evidence_age": night.evidence_age, "stale": night.stale, "new": done.new,
        "computed": done.computed, "history": str(config.history),
        "reports": str(config.reports / str(night.night)),
        "metrics": config.metrics and str(config.metrics),
    }  # fmt: skip
    return dict(plain(facts))
