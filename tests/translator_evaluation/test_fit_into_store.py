"""Fits in stores and on folders: which images are used, and which requests are refused."""

import numpy as np
import pytest

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.index.transaction import edit
from s2rtools.translation import METHODS, fit_split
from s2rtools.translation.colour_maps import MKL
from s2rtools.translation.image_set import ImageSet
from s2rtools.translation.method import FitResult, FitSettings, Options, TranslationMethod
from s2rtools.translation.translator_file import read_translator
from s2rtools.translator_evaluation import fit_into_store as fitting
from s2rtools.translator_evaluation.fit_into_store import FitRequest, fit_folders, fit_into_store
from s2rtools.translator_evaluation.judged_frames import named_translator
from s2rtools.translator_evaluation.report import ReportSettings, evaluate_folders
from s2rtools.translator_evaluation.tables import reports_text
from s2rtui.cli import main
from tests.translator_evaluation.scenes import recoloured, rooms, write_folder

PAIRED = FitSettings(paired=True)


@pytest.fixture
def used(monkeypatch: pytest.MonkeyPatch) -> list[ImageSet]:
    """The image sets of the fits by `mkl` in a test."""
    sets: list[ImageSet] = []

    def fit(
        source: ImageSet, target: ImageSet, settings: FitSettings, options: Options
    ) -> FitResult:
        sets.extend((source, target))
        return MKL.compute(source, target, settings, {"statistics": "domain"})

    method = TranslationMethod("mkl", "", MKL.translator, fit)
    monkeypatch.setitem(METHODS, "mkl", method)
    return sets


@pytest.mark.parametrize(
    ("count", "fitted", "held_out"),
    [(8, 8, 0), (16, 6, 8), (24, 14, 8), (40, 28, 8), (48, 30, 16), (96, 58, 32)],
)
def test_two_images_separate_the_fit_from_held_out_ones(count, fitted, held_out):
    codes = fit_split.split_codes(np.zeros(count, dtype=np.int32))
    assert (codes == fit_split.FITTED).sum() == fitted
    assert (codes == fit_split.HELD_OUT).sum() == held_out
    rows = [np.flatnonzero(codes == code) for code in (fit_split.FITTED, fit_split.HELD_OUT)]
    distances = np.abs(np.subtract.outer(*rows))
    assert distances.min(initial=count) > fit_split.BORDER


def test_recordings_are_split_on_their_own():
    groups = np.repeat([0, 1], [48, 16])
    together = fit_split.split_codes(groups)
    alone = [fit_split.split_codes(groups[groups == code]) for code in (0, 1)]
    assert (together == np.concatenate(alone)).all()


def test_fits_use_at_most_a_number_of_evenly_spaced_images(store_copy, used, monkeypatch):
    monkeypatch.setattr(fitting, "MAX_FITTED", 3)
    fit_into_store(store_copy, FitRequest("mkl", "few"), "")
    with s2rstore.open(store_copy) as store:
        translator = named_translator(store, "few")
        everything = np.flatnonzero(
            fit_split.split_codes(store.instances.trajectory) == fit_split.FITTED
        )
    assert [list(each.iids) for each in used] == [list(translator.fitted)] * 2
    assert translator.fitted.size == 3
    assert translator.fitted[[0, -1]].tolist() == everything[[0, -1]].tolist()
    assert not np.isin(translator.held_out, everything).any()


@pytest.mark.parametrize("direction", ["sim2real", "real2sim"])
def test_domains_of_the_wrong_kind_are_refused(store_copy, direction):
    with pytest.raises(RequestError, match="real is a real domain; name them as SIM,REAL"):
        fit_into_store(store_copy, FitRequest("mkl", "t", direction, ("real", "sim")), "")
    fit_into_store(store_copy, FitRequest("mkl", "t", direction, ("sim", "real")), "")
    with s2rstore.open(store_copy) as store:
        record = store.translator("t")
    expected = ("sim", "real") if direction == "sim2real" else ("real", "sim")
    assert (record.source_domain, record.target_domain) == expected


def test_a_translator_without_a_record_of_its_images_is_named(store_copy):
    fit_into_store(store_copy, FitRequest("mkl", "old"), "")
    with edit(store_copy) as draft:
        draft.delete("provenance", what="translator:old", key="split")
    with (
        s2rstore.open(store_copy) as store,
        pytest.raises(RequestError, match=r"translator old: .*fit it again"),
    ):
        named_translator(store, "old")


def test_pairs_are_refused_by_methods_that_do_not_use_them(store_copy, tmp_path):
    request = FitRequest("mkl", "t", settings=PAIRED)
    with pytest.raises(RequestError, match=r"--paired: mkl does not use pairs.*mkl\+residual"):
        fit_into_store(store_copy, request, "")
    with pytest.raises(RequestError, match="--paired: mkl does not use pairs"):
        fit_folders(tmp_path, tmp_path, request, tmp_path / "t.safetensors")


def test_pairs_in_a_store_need_poses(tmp_path, capsys):
    images = rooms(0, 8)
    folders = [str(write_folder(tmp_path / name, images)) for name in ("sim", "real")]
    path = tmp_path / "s.s2r"
    ingest = ["ingest", "images", "--sim", folders[0], "--real", folders[1], "--store", str(path)]
    assert main(ingest) == 0
    with pytest.raises(RequestError, match="--paired"):
        fit_into_store(path, FitRequest("mkl+residual", "t", settings=PAIRED), "")


def test_paired_folders_need_equal_file_names(tmp_path):
    source = write_folder(tmp_path / "camera", rooms(0, 8))
    target = write_folder(tmp_path / "simulation", recoloured(rooms(0, 8)), first=1)
    request = FitRequest("mkl+residual", "t", settings=FitSettings(steps=1, paired=True))
    with pytest.raises(RequestError, match=r"--paired: 000.png is not in both"):
        fit_folders(source, target, request, tmp_path / "t.safetensors")
    (target / "008.png").rename(target / "000.png")
    fit_folders(source, target, request, tmp_path / "t.safetensors")
    assert read_translator(tmp_path / "t.safetensors").method == "mkl+residual"


def test_folders_are_judged_on_images_that_the_fit_held_out(tmp_path, used):
    source = write_folder(tmp_path / "camera", rooms(0, 24))
    target = write_folder(tmp_path / "simulation", recoloured(rooms(1, 24)))
    file = tmp_path / "t.safetensors"
    verdict = fit_folders(source, target, FitRequest("mkl", "mkl"), file)
    assert verdict is not None
    assert verdict.passed
    assert [len(each) for each in used] == [14, 14]
    assert "016.png" not in used[0].names
    stored = read_translator(file)
    judged = evaluate_folders(source, target, stored, "t", ReportSettings())
    assert (judged.images, judged.held_out) == (8, True)
    assert "8 images that no translator was fitted on" in reports_text([judged], None)
    (source / "000.png").unlink()
    other = evaluate_folders(source, target, stored, "t", ReportSettings())
    assert (other.images, other.held_out) == (23, None)
    assert "23 images of folders, perhaps used to train" in reports_text([other], None)


def test_small_folders_are_judged_on_images_of_the_fit_and_say_so(tmp_path):
    source = write_folder(tmp_path / "camera", rooms(0, 6))
    target = write_folder(tmp_path / "simulation", recoloured(rooms(1, 6)))
    file = tmp_path / "t.safetensors"
    assert fit_folders(source, target, FitRequest("mkl", "mkl"), file) is None
    judged = evaluate_folders(source, target, read_translator(file), "t", ReportSettings())
    assert (judged.images, judged.held_out) == (6, False)
    assert "6 images of the fit" in reports_text([judged], None)
