"""`s2r translate`: fit translators between domains, apply them and judge them."""

from __future__ import annotations

import argparse
import json
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from s2rstore.errors import RequestError
from s2rstore.records import SIDES
from s2rtools.common.command_line import output, store_argument
from s2rtools.common.command_line.assignments import parse_assignments
from s2rtools.common.command_line.progress import percent_callback, reporter

if TYPE_CHECKING:
    from s2rstore.reader import Store
    from s2rtools.translation.method import ReportProgress
    from s2rtools.translator_evaluation.fit_into_store import FitRequest
    from s2rtools.translator_evaluation.judged_frames import Translation
    from s2rtools.translator_evaluation.measures import Verdict
    from s2rtools.translator_evaluation.report import ReportSettings, TranslatorReport

_IMAGES = 120
"""Most images on which translators are judged."""
EXAMPLE = "s2r translate fit mkl --direction real2sim --name to_sim --store lab.s2r"


def add_actions(
    parser: argparse.ArgumentParser,
) -> argparse._SubParsersAction[argparse.ArgumentParser]:
    """Add the actions that the tools have; returns what further actions are added to."""
    actions = parser.add_subparsers(metavar="ACTION", title="actions", required=True)
    fit = actions.add_parser("fit", help="fit a translator on the images of two domains")
    _add_fit_arguments(fit)
    fit.set_defaults(action=_fit)
    apply = actions.add_parser("apply", help="translate images, a folder, a video or a bag")
    apply.add_argument("translator", help="translator file, or name of a translator of --store")
    apply.add_argument("input", type=Path, help="image, folder of images, video or bag")
    apply.add_argument("output", type=Path, help="what is written; must not exist")
    apply.add_argument("--store", type=store_argument.folder, help="store that has the translator")
    apply.add_argument("--strength", type=float, default=1.0, help="0 to 1 (default 1)")
    apply.set_defaults(action=_apply)
    report = actions.add_parser("report", help="judge translators: content, distance, task, cost")
    _add_report_arguments(report)
    report.set_defaults(action=_report)
    judge = actions.add_parser("judge", help="judge a folder of images of another program")
    _add_judge_arguments(judge)
    judge.set_defaults(action=_judge)
    return actions


def _add_fit_arguments(fit: argparse.ArgumentParser) -> None:
    fit.add_argument("method", help="method of the fit, or `all`; the reference lists them")
    add = fit.add_argument_group("images").add_argument
    add(
        "--store",
        type=store_argument.folder,
        help="store folder; the translator is registered in it",
    )
    add("--direction", choices=("sim2real", "real2sim"), default="sim2real",
        help="which images are translated (default sim2real)")  # fmt: skip
    add("--domains", metavar="SIM,REAL", help="names of both domains (default: the first of each)")
    add("--source", type=Path, metavar="DIR", help="folder of images to translate, without a store")
    add("--target", type=Path, metavar="DIR", help="folder of images of the target domain")
    add("--size", type=int, default=160, metavar="PX",
        help="longer edge of the images of the fit (default 160)")  # fmt: skip
    add("--lower", default="1", metavar="SHARE",
        help="translate the lowest SHARE of the rows alone, such as 0.5 (default 1)")  # fmt: skip
    add("--paired", action="store_true",
        help="use that both domains show the same scenes (mkl+residual)")  # fmt: skip
    add("--depth-noise", action="store_true",
        help="also degrade depth by the measured noise of the target")  # fmt: skip
    add = fit.add_argument_group("result").add_argument
    add("--name", help="name of the translator in the store (default: method and direction)")
    add("--out", type=Path, metavar="FILE",
        help="translator file to write, with --source; a folder with `all`")  # fmt: skip
    add = fit.add_argument_group("budget").add_argument
    add("--minutes", type=float, help="training time, in place of the default number of steps")
    add("--steps", type=int, help="number of training steps")
    add("--seed", type=int, default=0, help="random seed (default 0)")
    add("--option", action="append", default=[], metavar="NAME=VALUE",
        help="option of the method, such as statistics=image")  # fmt: skip
    add = fit.add_argument_group("judgement").add_argument
    add("--report", action="store_true", help="judge what was fitted, as `s2r translate report`")
    add("--run", help="run whose network judges the task (default: none)")
    fit.set_defaults(
        images=_IMAGES, trust=False, no_keep=False, json=False, downstream=None, truth=None
    )


def _add_judge_arguments(judge: argparse.ArgumentParser) -> None:
    judge.add_argument("folder", type=Path, help="folder of images, named by the iids of their "
                       "instances, such as 17.png")  # fmt: skip
    judge.add_argument("--like", choices=SIDES, required=True,
                       help="what they shall look like: real ones (made from simulated images) or "
                       "sim ones (made from real images)")  # fmt: skip
    judge.add_argument("--store", type=store_argument.folder, required=True, help="store folder")
    judge.add_argument("--domains", metavar="SIM,REAL", help="names of both domains (default: the "
                       "first of each)")  # fmt: skip
    _add_judged_images(judge)
    judge.add_argument("--run", help="run whose network judges the task (default: none)")
    judge.add_argument("--trust", action="store_true", help="allow model formats that execute code")
    judge.add_argument("--out", type=Path, metavar="DIR",
                       help="write a contact sheet and report.json to this folder")  # fmt: skip
    judge.add_argument("--json", action="store_true", help="print the report as JSON")


def _add_judged_images(parser: argparse.ArgumentParser | argparse._ArgumentGroup) -> None:
    parser.add_argument("--images", type=int, default=_IMAGES, metavar="N",
                        help=f"most images that are judged (default {_IMAGES})")  # fmt: skip
    parser.add_argument("--seed", type=int, default=1,
                        help="random seed that draws images (default 1)")  # fmt: skip


def _add_report_arguments(report: argparse.ArgumentParser) -> None:
    report.add_argument("translators", nargs="*", metavar="T",
                        help="translators of --store (default: all), or translator files with "
                        "--source")  # fmt: skip
    group = report.add_argument_group("images")
    add = group.add_argument
    add("--store", type=store_argument.folder, help="store that has the translators")
    add("--source", type=Path, metavar="DIR", help="folder of images to translate, without a store")
    add("--target", type=Path, metavar="DIR", help="folder of images of the target domain")
    _add_judged_images(group)
    add = report.add_argument_group("task").add_argument
    add("--run", help="run whose network judges the task (default: none)")
    add("--trust", action="store_true", help="allow model formats that execute code")
    add(
        "--downstream",
        metavar="MODULE:NAME",
        help="Python model that judges the images of --source before and after translation",
    )
    add(
        "--truth",
        type=Path,
        metavar="DIR",
        help="truth of each image of --source for --downstream: .png, .npy or .json",
    )
    add = report.add_argument_group("output").add_argument
    add("--out", type=Path, metavar="DIR",
        help="write a contact sheet of each translator and report.json to this folder")  # fmt: skip
    add("--no-keep", action="store_true", help="do not save the verdict in the store")
    add("--json", action="store_true", help="print the report as JSON")


def _fit(options: argparse.Namespace) -> None:
    from s2rtools.translation import METHODS

    _check_budget(options)
    if (options.store is None) == (options.source is None):
        raise RequestError("name --store S, or --source DIR and --target DIR with --out FILE")
    methods = tuple(METHODS) if options.method == "all" else (options.method,)
    if options.name and len(methods) > 1:
        raise RequestError("--name: not with `all`, which names each translator by its method")
    if options.store is None:
        files = _fit_folders(options, methods)
        options.translators = [str(file) for file in files]
    else:
        options.translators = _fit_store(options, methods)
    if options.report:
        _report(options)


def _fit_store(options: argparse.Namespace, methods: tuple[str, ...]) -> list[str]:
    """Register a translator per method; with `all`, those of an earlier call are kept."""
    import s2rstore
    from s2rtools.translator_evaluation.fit_into_store import fit_into_store

    command = shlex.join(["s2r", *sys.argv[1:]])
    with s2rstore.open(options.store) as store:
        known = set(store.translators)
    names = []
    for method in methods:
        name = options.name or f"{method}-{options.direction}"
        names.append(name)
        if len(methods) > 1 and name in known:
            print(f"{options.store}: translator {name} is registered already")
            continue
        with reporter() as progress:
            report = percent_callback(progress, f"fit {name}")
            verdict = fit_into_store(
                options.store, _request(options, method, name, report), command
            )
        print(f"{options.store}: translator {name} registered, {_outcome(verdict)}")
    return names


def _outcome(verdict: Verdict | None) -> str:
    if verdict is None:
        return "not checked: too few images are held out"
    return "accepted" if verdict.passed else f"refused: {'; '.join(verdict.reasons)}"


def _fit_folders(options: argparse.Namespace, methods: tuple[str, ...]) -> list[Path]:
    """Write a translator file per method; with `all`, those of an earlier call are kept."""
    from s2rtools.translator_evaluation.fit_into_store import fit_folders

    if options.target is None or options.out is None:
        raise RequestError("--source needs --target DIR and --out FILE (a folder with `all`)")
    files = []
    for method in methods:
        file = options.out / f"{method}.safetensors" if len(methods) > 1 else options.out
        files.append(file)
        if len(methods) > 1 and file.exists():
            print(f"{file}: exists already")
            continue
        with reporter() as progress:
            report = percent_callback(progress, f"fit {method}")
            request = _request(options, method, method, report)
            verdict = fit_folders(options.source, options.target, request, file)
        print(f"{file}: {method} from {options.source} to {options.target}, {_outcome(verdict)}")
    return files


def _check_budget(options: argparse.Namespace) -> None:
    if options.minutes is not None and not 0 < options.minutes <= 10_000:
        raise RequestError("--minutes: must be more than 0 and at most 10000")
    if options.steps is not None and options.steps < 1:
        raise RequestError("--steps: must be at least 1")
    if not 0 <= options.seed < 2**31:
        raise RequestError("--seed: must be 0 to 2147483647")
    if not 32 <= options.size <= 1024:
        raise RequestError("--size: must be 32 to 1024")


def _request(
    options: argparse.Namespace, method: str, name: str, report: ReportProgress
) -> FitRequest:
    from s2rtools.translation import METHODS
    from s2rtools.translation.method import FitSettings, lower_share
    from s2rtools.translator_evaluation.fit_into_store import FitRequest

    texts = parse_assignments("--option", options.option)
    METHODS.find(method).parse(texts)
    settings = FitSettings(
        seed=options.seed, steps=options.steps, minutes=options.minutes, paired=options.paired,
        options=texts, report=report, lower=lower_share(options.lower, "--lower"),
    )  # fmt: skip
    return FitRequest(
        method, name, options.direction, _domains(options), options.depth_noise, options.size,
        settings,
    )  # fmt: skip


def _domains(options: argparse.Namespace) -> tuple[str, str] | None:
    if options.domains is None:
        return None
    sim, _, real = options.domains.partition(",")
    if not sim or not real:
        raise RequestError(f"--domains {options.domains}: name two domains, SIM,REAL")
    return sim, real


def _apply(options: argparse.Namespace) -> None:
    from s2rtools.translation.apply_files import apply_to_files
    from s2rtools.translation.translator_file import load_translator

    if not 0 <= options.strength <= 1:
        raise RequestError("--strength: must be 0 to 1")
    stored = load_translator(options.translator, options.store)
    with reporter() as progress:
        result = apply_to_files(
            stored.translator, options.strength, options.input, options.output, progress
        )
    print(f"{options.output}: {result.summary()} by {options.translator}")


def _report(options: argparse.Namespace) -> None:
    if (options.store is None) == (options.source is None):
        raise RequestError("name --store S, or --source DIR and --target DIR")
    _check_judged_images(options)
    if (options.downstream is None) != (options.truth is None):
        raise RequestError("--downstream MODULE:NAME and --truth DIR belong together")
    if options.store is None:
        _report_folders(options)
    elif options.downstream is not None:
        raise RequestError("--downstream: needs --source DIR; a store is judged by --run")
    else:
        _report_store(options)


def _check_judged_images(options: argparse.Namespace) -> None:
    if not 8 <= options.images <= 100_000:
        raise RequestError(f"--images {options.images}: must be 8 to 100000")
    if not 0 <= options.seed < 2**31:
        raise RequestError("--seed: must be 0 to 2147483647")


def _judge(options: argparse.Namespace) -> None:
    import s2rstore
    from s2rtools.translator_evaluation.judged_frames import generated_images

    _check_judged_images(options)
    with s2rstore.open(options.store) as store:
        generated = generated_images(store, options.folder, options.like, _domains(options))
        _judge_in_store(options, store, [generated])


def _judge_in_store(
    options: argparse.Namespace, store: Store, translators: Sequence[Translation]
) -> list[TranslatorReport]:
    """Judge translations, draw their contact sheets, and print the report."""
    from s2rtools.translator_evaluation import report

    with reporter() as progress:
        show = percent_callback(progress, "judge translators")
        found = report.evaluate(
            store, translators, _settings(options), lambda fraction, name: show(fraction, 0.0, 0.0)
        )
    _print_reports(options, [found])
    return found


def _settings(options: argparse.Namespace) -> ReportSettings:
    from s2rtools.translator_evaluation.report import ReportSettings

    return ReportSettings(options.run, options.images, options.seed, options.trust, _out(options))


def _report_store(options: argparse.Namespace) -> None:
    import s2rstore
    from s2rstore.index.transaction import check_writable
    from s2rtools.translator_evaluation import report
    from s2rtools.translator_evaluation.judged_frames import named_translator

    if not options.no_keep:
        check_writable(options.store)
    with s2rstore.open(options.store) as store:
        names = options.translators or list(store.translators)
        if not names:
            raise RequestError(
                f"{options.store}: no translators; make one with `s2r translate fit`"
            )
        translators = [named_translator(store, name) for name in dict.fromkeys(names)]
        found = _judge_in_store(options, store, translators)
    if not options.no_keep:
        report.save_reports(options.store, found)


def _report_folders(options: argparse.Namespace) -> None:
    from s2rtools.translation.translator_file import load_translator
    from s2rtools.translator_evaluation import report
    from s2rtools.translator_evaluation.downstream import load_downstream

    if options.target is None or not options.translators:
        raise RequestError("--source needs --target DIR and translator files")
    if options.run is not None:
        raise RequestError("--run: needs --store, because folders have no poses")
    downstream = None
    if options.downstream is not None:
        model = load_downstream(options.downstream)
        downstream = report.Downstream(model, options.truth)
    settings = _settings(options)
    found = [
        report.evaluate_folders(
            options.source, options.target, load_translator(file), Path(file).stem, settings,
            downstream,
        )
        for file in options.translators
    ]  # fmt: skip
    _print_reports(options, [[each] for each in found])


def _out(options: argparse.Namespace) -> Path | None:
    """The folder of the report and the contact sheets; a fit of one file has none."""
    out: Path | None = options.out
    return None if out is not None and out.suffix == ".safetensors" else out


def _print_reports(
    options: argparse.Namespace, groups: Sequence[Sequence[TranslatorReport]]
) -> None:
    """Print the tables of translators that were judged on the same images, or the JSON of all.

    The JSON is also written to the folder of --out.
    """
    from s2rtools.translator_evaluation.report import as_json
    from s2rtools.translator_evaluation.tables import reports_text

    content = [as_json(each) for group in groups for each in group]
    document = json.dumps(content, indent=1, sort_keys=True, allow_nan=False) + "\n"
    if out := _out(options):
        output.write_file(out / "report.json", document.encode())
    text = "\n\n".join(reports_text(group, options.run) for group in groups) + "\n"
    sys.stdout.write(document if options.json else text)
    if out:
        print(f"wrote {out}", file=sys.stderr)
