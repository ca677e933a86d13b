"""`s2r nightly`: measure one night, add it to the gap history, write its reports."""

from __future__ import annotations

import argparse
import datetime
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from s2rstore.errors import RequestError
from s2rtools.precompute.executors import slurm_command

if TYPE_CHECKING:
    from s2rtools.nightly.config import NightlyConfig
    from s2rtools.nightly.run import NightRun
EXAMPLE = "s2r nightly nightly.toml"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("config", type=Path, metavar="CONFIG.toml", help="configuration file")
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    add = parser.add_argument_group("date").add_argument
    add("--night", metavar="YYYY-MM-DD", help="date of the night (default: today, UTC)")
    add("--far-night", action="store_true",
        help="accept a date more than a month before or a year after the newest night")  # fmt: skip
    add("--withdraw", metavar="YYYY-MM-DD",
        help="measure nothing; withdraw this night from the history")  # fmt: skip
    slurm_command.add_arguments(parser)


def execute(options: argparse.Namespace) -> int:
    from s2rtools.nightly import config as configs
    from s2rtools.nightly.run import nightly

    config = configs.read(options.config)
    if slurm_command.is_requested(options):
        arguments = command_arguments(options)
        return slurm_command.SlurmJob(options).run(arguments)
    if options.withdraw is not None:
        return _withdraw(config, options)
    result = nightly(config, _night(options.night), far=options.far_night)
    if options.json:
        print(json.dumps(_as_dict(config, result), indent=1, sort_keys=True))
    else:
        _print_result(config, result)
    if result.night.refused:
        print(f"s2r: {result.night.reason}", file=sys.stderr)
    return result.night.exit_code


def command_arguments(options: argparse.Namespace) -> list[str]:
    """The arguments of `s2r` that measure the same night in another working folder.

    The night is named, because the job may begin on another day.
    """
    if options.withdraw is not None:
        _date("--withdraw", options.withdraw)
        night = options.night
    else:
        night = str(_night(options.night))
    dates = {"night": night, "withdraw": options.withdraw}
    given = [f"--{name}={value}" for name, value in dates.items() if value is not None]
    flags = {"--json": options.json, "--far-night": options.far_night}
    given += [flag for flag, is_set in flags.items() if is_set]
    return ["nightly", *given, str(options.config.absolute())]


def _night(text: str | None) -> datetime.date:
    today = datetime.datetime.now(datetime.UTC).date()
    if text is None:
        return today
    night = _date("--night", text)
    if night > today + datetime.timedelta(days=7):
        raise RequestError(f"--night {text}: is more than a week after today ({today})")
    return night


def _date(option: str, text: str) -> datetime.date:
    try:
        return datetime.date.fromisoformat(text)
    except ValueError as error:
        raise RequestError(f"{option} {text}: is not a date; write it as 2026-11-21") from error


def _withdraw(config: NightlyConfig, options: argparse.Namespace) -> int:
    from s2rtools.nightly.run import withdraw

    if options.night is not None:
        raise RequestError("--withdraw and --night: give one of them")
    night = _date("--withdraw", options.withdraw)
    withdrawn = withdraw(config, night)
    if options.json:
        rows = [each.id for each in withdrawn]
        fields = {"name": config.name, "withdrawn": str(night), "rows": rows}
        print(json.dumps({**fields, "history": str(config.history)}, indent=1, sort_keys=True))
    else:
        print(
            f"{night}: withdrawn from {config.name} (its records remain, marked, in "
            f"{config.history}); its reports remain in {config.reports / str(night)}"
        )
    return 0


def _print_result(config: NightlyConfig, result: NightRun) -> None:
    from s2rtools.nightly.report_model import checks

    night = result.night
    for check in checks(night):
        print(f"{check.outcome:<12}  {check.name}: {check.message}")
    print(f"\n{night.night}: {night.outcome}; reports in {config.reports / str(night.night)}")
    if not result.new:
        print("no new evidence: the night is in the history already", file=sys.stderr)
    elif not result.computed:
        print("no new recordings: the figures are those of an earlier night", file=sys.stderr)


def _as_dict(config: NightlyConfig, result: NightRun) -> dict[str, object]:
    from s2rtools.gap.report import plain

    night = result.night
    fields = {
        "name": night.name, "night": str(night.night), "run": night.run, "key": night.key,
        "outcome": night.outcome, "exit_code": night.exit_code, "worst": night.worst,
        "gap": night.gap.value, "gap_low": night.gap.low, "gap_high": night.gap.high,
        "threshold": night.threshold, "reason": night.reason, "golden": night.golden,
        "change": night.change, "change_reason": night.change_reason,
        "evidence_age": night.evidence_age, "stale": night.stale, "new": result.new,
        "computed": result.computed, "history": str(config.history),
        "reports": str(config.reports / str(night.night)),
        "metrics": config.metrics and str(config.metrics),
    }  # fmt: skip
    return dict(plain(fields))
