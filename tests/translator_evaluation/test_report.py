"""Reports of translators of a small store, from the fit to the saved verdict."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.index.transaction import edit
from s2rstore.intervals import Interval
from s2rtools.precompute.run_registration import add_run
from s2rtools.translation.colour_maps import IdentityTranslator
from s2rtools.translation.translator_file import StoredTranslator
from s2rtools.translator_evaluation import report, task_metrics
from s2rtools.translator_evaluation.contact_sheet import draw_sheet
from s2rtools.translator_evaluation.fit_into_store import FitRequest, fit_into_store
from s2rtools.translator_evaluation.judged_frames import named_translator
from s2rtui.cli import main
from tests.support.copies import copy_store
from tests.translator_evaluation.scenes import recoloured, rooms, write_folder

METHODS = ("identity", "mkl")


class Negative(IdentityTranslator):
    """Inverts bright and dark."""

    def translate(self, rgb: np.ndarray) -> np.ndarray:
        return 255 - rgb


@pytest.fixture(scope="module")
def root(trained_store: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store with a briefly trained run `vanilla` and translators of both methods."""
    path = copy_store(trained_store, tmp_path_factory.mktemp("judged") / "s.s2r")
    for method in METHODS:
        fit_into_store(path, FitRequest(method, method, "real2sim"), "s2r translate fit")
    return path


@pytest.fixture(scope="module")
def reports(root: Path) -> dict[str, report.TranslatorReport]:
    with s2rstore.open(root) as store:
        translators = [named_translator(store, name) for name in METHODS]
        settings = report.ReportSettings(run="vanilla")
        return {each.name: each for each in report.evaluate(store, translators, settings)}


@pytest.fixture(scope="module")
def negative(root: Path) -> report.TranslatorReport:
    with s2rstore.open(root) as store:
        known = named_translator(store, "mkl")
        stored = StoredTranslator(Negative(), known.source, known.target, known.stored.size)
        inverting = replace(known, stored=stored)
        (judged,) = report.evaluate(store, [inverting], report.ReportSettings())
    return judged


def test_identity_changes_nothing_and_earns_no_claim(reports):
    judged = reports["identity"]
    assert judged.verdict.passed
    gain = judged.row("error_gain")
    assert (gain.interval.value, gain.run, gain.unit) == (0, "vanilla", "m")
    assert task_metrics.claim(gain.interval).startswith("no claim")
    assert judged.row("features_gain").interval.value == 0
    for metric in ("kid_network", "kid_colour", "w1_red"):
        assert judged.row(metric).interval.value == judged.row(metric, "identity").interval.value


def test_reports_are_made_on_images_that_no_translator_was_fitted_on(root, reports):
    assert all(judged.held_out for judged in reports.values())
    assert all("run vanilla is not computed" in "; ".join(r.notes) for r in reports.values())
    with s2rstore.open(root) as store:
        fitted, held_out = (
            getattr(named_translator(store, "mkl"), part) for part in ("fitted", "held_out")
        )
        assert reports["mkl"].images == held_out.size
        assert not np.isin(held_out, fitted).any()
        # Two images on each side of the held-out block lie in neither part.
        assert fitted.size + held_out.size == len(store.instances) - 4


def test_errors_stand_beside_those_without_translation_and_of_the_target(reports):
    judged = reports["mkl"]
    before, after = judged.row("error", "identity"), judged.row("error")
    assert judged.row("error_gain").interval.value == pytest.approx(
        before.interval.value - after.interval.value
    )
    assert judged.row("error", "target").interval.value > 0
    assert {"identity", "repeated_image", "target", "translator"} == {
        row.reference for row in judged.rows if row.metric == "kid_network"
    }


def test_a_negative_is_refused_and_can_only_be_forced(root, negative, tmp_path):
    assert "inverted" in "; ".join(negative.verdict.reasons)
    path = copy_store(root, tmp_path / "own.s2r")
    report.save_reports(path, [negative])
    with s2rstore.open(path) as store:
        record = store.translator("mkl")
        assert record.accepted is False
        assert record.reasons == negative.verdict.reasons
    chain = {"sim": [], "real": [{"name": "translate:mkl", "value": 1.0}]}
    with pytest.raises(RequestError, match="inverted"):
        add_run(path, "dark", "vanilla", None, None, chain)
    assert add_run(path, "dark", "vanilla", None, None, chain, force=True) == "dark"


def test_figures_of_other_runs_stay(root, reports, tmp_path):
    path = copy_store(root, tmp_path / "own.s2r")
    judged = reports["mkl"]

    def runs() -> set[tuple[str, str | None]]:
        with s2rstore.open(path) as store:
            found = store.execute(
                "SELECT metric, run FROM translator_metric "
                "WHERE metric IN ('error_gain', 'cost') AND reference = 'translator'"
            )
            return set(found)

    report.save_reports(path, [judged])
    plain = [row for row in judged.rows if row.run is None]
    other = [replace(row, run="other") for row in judged.rows if row.run is not None]
    report.save_reports(path, [replace(judged, run=None, rows=tuple(plain))])
    assert runs() == {("cost", None), ("error_gain", "vanilla")}
    report.save_reports(path, [replace(judged, run="other", rows=(*plain, *other))])
    both = {("cost", None), ("error_gain", "vanilla"), ("error_gain", "other")}
    assert runs() == both
    trained = replace(plain[0], metric="trained_error", run="other")
    report.save_reports(path, [replace(judged, run="vanilla", rows=(*judged.rows, trained))])
    assert runs() == both
    report.save_reports(path, [replace(judged, run="other", rows=tuple(plain))])
    assert runs() == {("cost", None), ("error_gain", "vanilla")}


def test_translators_of_sim_images_claim_nothing_about_reality(root):
    with s2rstore.open(root) as store:
        known = named_translator(store, "identity")
        turned = replace(known, direction="sim2real", source="sim", target="real")
        (judged,) = report.evaluate(store, [turned], report.ReportSettings(run="vanilla"))
    assert judged.row("error_gain") is None
    assert judged.row("sim_error_gain").interval.value == 0


def test_networks_trained_on_translated_images_are_compared_with_the_run(store_copy):
    chain = [{"name": "translate:T", "value": 1.0, "sha256": "0" * 64}]
    with edit(store_copy) as draft:
        draft.update("run", {"run": "dataaug"}, {"sim_adjustments": json.dumps(chain)})
        draft.set_provenance("model:dataaug", {"recipe": "translated"})
    with s2rstore.open(store_copy) as store:
        unseen = np.flatnonzero(store.run_columns("vanilla").sim.split != 0)
        kept = unseen[::2]
        found = task_metrics.training_metrics(store, "vanilla", "T", kept)
        rows = {row.metric: row for row in found}
        assert not task_metrics.training_metrics(store, "vanilla", "other", kept)
        assert not task_metrics.training_metrics(store, "dataaug", "T", kept)
        errors = [store.run_columns(run).real.error[kept].mean() for run in ("vanilla", "dataaug")]
    gain = rows["trained_error_gain"]
    assert gain.run == "dataaug"
    assert gain.interval.value == pytest.approx(errors[0] - errors[1], rel=1e-5)
    assert rows["trained_error"].interval.value == pytest.approx(errors[1], rel=1e-5)


@pytest.mark.parametrize(
    ("interval", "text"),
    [
        (Interval(0.2, 0.5, 0.8), "0.50 m less error"),
        (Interval(-0.8, -0.5, -0.2), "0.50 m more error"),
        (Interval(-0.1, 0.5, 1.0), "no claim: the interval holds zero"),
        (Interval.unknown(0.5, "n 8, a mean needs 49"), "no claim: no interval: n 8"),
    ],
)
def test_claims_are_made_only_where_the_interval_excludes_zero(interval, text):
    assert task_metrics.claim(interval).startswith(text)


def test_the_command_prints_tables_and_writes_sheets(root, tmp_path, capsys):
    path, out = copy_store(root, tmp_path / "own.s2r"), tmp_path / "out"
    request = ["translate", "report", "--store", str(path), "--run", "vanilla", "--out", str(out)]
    assert main(request) == 0
    text = capsys.readouterr().out
    for part in ("Verdict", "Content kept", "one repeated target image", "Task", "no claim"):
        assert part in text
    assert {file.name for file in out.iterdir()} == {"identity.png", "mkl.png", "report.json"}
    assert cv2.imread(str(out / "mkl.png")).shape[1] > 600
    assert json.loads((out / "report.json").read_text())[1]["name"] == "mkl"
    with s2rstore.open(path) as store:
        saved = store.execute(
            "SELECT DISTINCT run FROM translator_metric WHERE metric = 'error_gain'"
        )
        assert list(saved) == [("vanilla",)]


def test_folders_are_judged_without_a_store(tmp_path, capsys):
    source = str(write_folder(tmp_path / "camera", rooms(0, 6)))
    target = str(write_folder(tmp_path / "simulation", recoloured(rooms(1, 6))))
    file, out = str(tmp_path / "look.safetensors"), tmp_path / "out"
    folders = ["--source", source, "--target", target]
    assert main(["translate", "fit", "mkl", *folders, "--out", file]) == 0
    capsys.readouterr()
    assert main(["translate", "report", file, *folders, "--out", str(out), "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content[0]["verdict"]["passed"]
    assert (out / "look.png").exists()
    assert main(["translate", "report", file, *folders]) == 0
    assert "6 images of the fit" in capsys.readouterr().out


def test_a_store_without_poses_is_judged_by_content_and_colours(tmp_path, capsys):
    real = str(write_folder(tmp_path / "real", rooms(0, 30)))
    sim = str(write_folder(tmp_path / "sim", recoloured(rooms(1, 30))))
    path = str(tmp_path / "s.s2r")
    assert main(["ingest", "images", "--sim", sim, "--real", real, "--store", path]) == 0
    fit = ["translate", "fit", "mkl", "--direction", "real2sim", "--name", "mkl", "--store", path]
    assert main(fit) == 0
    capsys.readouterr()
    report_command = ["translate", "report", "--store", path, "--out", str(tmp_path / "out")]
    assert main(report_command) == 0
    text = capsys.readouterr().out
    assert "accepted" in text
    assert "KID colour" in text
    assert main([*report_command, "--run", "vanilla"]) == 2
    assert "no poses" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("request_text", "message"),
    [
        ("", "name --store S, or --source"),
        ("--store STORE", "no translators"),
        ("--store STORE nothing", "translators: none"),
        ("--store STORE --images 2", "--images 2"),
        ("--store STORE --seed -1", "--seed"),
        ("x.safetensors --source a", "--target"),
        ("x.safetensors --source a --target b --run vanilla", "--run"),
    ],
)
def test_wrong_requests_end_in_one_line(tiny_store, s2r, request_text, message):
    words = request_text.replace("STORE", str(tiny_store)).split()
    s2r("translate", "report", *words).assert_refused(message)


def test_sheets_show_every_image_and_are_wide_enough_to_read():
    images = rooms(0, 3)
    sheet = draw_sheet([("a", images), ("b", recoloured(images))], ["1", "2", "3"], seed=4)
    assert sheet.shape[1] >= 2 * 256
    for image in (*images, *recoloured(images)):
        enlarged = cv2.resize(image, None, fx=2, fy=2, interpolation=cv2.INTER_NEAREST)
        found = cv2.matchTemplate(sheet, enlarged, cv2.TM_SQDIFF).min()
        assert found == pytest.approx(0, abs=enlarged.size * 0.01)


@pytest.fixture
def generated(root: Path, tmp_path: Path) -> Path:
    """The held-out images as `mkl` translates them, in a folder, named by their iids."""
    with s2rstore.open(root) as store:
        translator = named_translator(store, "mkl")
        (tmp_path / "gan").mkdir()
        for iid in translator.held_out.tolist():
            rgb = translator.stored.translator.translate(store.frame("real", iid).rgb[None])[0]
            cv2.imwrite(str(tmp_path / "gan" / f"{iid:06d}.png"), rgb[..., ::-1])
    return tmp_path / "gan"


def test_a_folder_is_judged_as_the_translator_that_made_it(s2r, root, generated, tmp_path):
    out = tmp_path / "sheets"
    (judged,) = s2r("translate", "judge", generated, "--like", "sim", "--store", root, "--json",
                    "--out", out).json  # fmt: skip
    (report,) = s2r("translate", "report", "mkl", "--store", root, "--no-keep", "--json").json
    assert {row["metric"] for row in report["rows"]} - {row["metric"] for row in judged["rows"]} \
        == {"cost"}  # fmt: skip
    assert judged["rows"] == [row for row in report["rows"] if row["metric"] != "cost"]
    assert judged["verdict"] == report["verdict"]
    assert (judged["name"], judged["method"], judged["held_out"]) == ("gan", "folder", None)
    assert cv2.imread(str(out / "gan.png")) is not None


def test_a_folder_of_negatives_is_refused(s2r, root, generated):
    for path in generated.iterdir():
        cv2.imwrite(str(path), 255 - cv2.imread(str(path)))
    text = s2r("translate", "judge", generated, "--like", "sim", "--store", root).printed
    assert "gan: refused" in text
    assert "perhaps used to train" in text


@pytest.mark.parametrize(
    ("name", "message"),
    [("chair.png", "name it by the iid"), ("99999.png", "instance 99999 has no images"),
     ("{first}.jpg", "has another image")],
)  # fmt: skip
def test_images_of_no_single_instance_are_refused(s2r, root, generated, name, message):
    first = sorted(generated.iterdir())[0]
    (generated / name.format(first=first.stem)).write_bytes(first.read_bytes())
    judge = ("translate", "judge", generated, "--like", "sim", "--store", root)
    assert message in s2r(*judge).checked(2).err
