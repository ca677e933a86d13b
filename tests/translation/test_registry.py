"""Methods of installed packages, and translators of the lower rows alone."""

import os
import subprocess
import sys

import cv2
import numpy as np
import pytest

from s2rstore.errors import RequestError
from s2rtools.translation import METHODS, find_method
from s2rtools.translation.method import FitSettings
from s2rtools.translation.translator_file import StoredTranslator, decode, encode
from tests.translation.palette_world import counterparts, image_set, unpaired

PLUG_IN = """
import numpy as np
from s2rtools.translation.method import FitResult, Option, TranslationMethod, Translator

class Brighter(Translator):
    method = "brighter"

    def __init__(self, offset):
        self.offset = offset

    def apply(self, rgb):
        return np.clip(rgb.astype(int) + int(self.offset[0]), 0, 255).astype(np.uint8)

    def tensors(self):
        return {"offset": self.offset}

    @classmethod
    def restore(cls, tensors, settings):
        return cls(tensors["offset"].reshape(1))

def fit(source, target, settings, options):
    offset = target.images.mean() - source.images.mean()
    return FitResult(Brighter(np.array([options["share"] * offset])))

METHOD = TranslationMethod(
    "brighter", "one offset", Brighter, fit, options={"share": Option(1.0, 0, 1)}
)
"""


def test_an_installed_package_adds_a_method(tmp_path):
    """It is fitted, stored, applied and judged like any other; a taken name is refused."""
    (tmp_path / "brighter.py").write_text(PLUG_IN, encoding="utf-8")
    declared = tmp_path / "brighter-1.0.dist-info"
    declared.mkdir()
    (declared / "METADATA").write_text("Metadata-Version: 2.1\nName: brighter\nVersion: 1.0\n")
    entry = declared / "entry_points.txt"
    entry.write_text("[s2r.translators]\nbrighter = brighter:METHOD\n")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])}
    for name, shade in (("dark", 60), ("bright", 160)):
        folder = tmp_path / name
        folder.mkdir()
        for number in range(4):
            image = np.full((32, 48, 3), shade + 5 * number, dtype=np.uint8)
            cv2.imwrite(str(folder / f"{number}.png"), image)
    file, out = tmp_path / "b.safetensors", tmp_path / "out"

    def run(*words):
        command = [sys.executable, "-m", "s2rtui", "translate", *words]
        return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)

    folders = ("--source", str(tmp_path / "dark"), "--target", str(tmp_path / "bright"))
    fitted = run("fit", "brighter", *folders, "--out", str(file), "--option", "share=0.5")
    assert fitted.returncode == 0, fitted.stderr
    assert run("apply", str(file), str(tmp_path / "dark"), str(out)).returncode == 0
    assert (cv2.imread(str(out / "0.png")) == 110).all()
    for text, broken, message in (
        ("mkl = brighter:METHOD", PLUG_IN, "translator mkl: brighter:METHOD: the name is taken"),
        ("other = brighter:METHOD", PLUG_IN, "is no TranslationMethod named 'other'"),
        ("brighter = brighter:METHOD", "raise ValueError('no')", "cannot be loaded: no"),
    ):
        entry.write_text(f"[s2r.translators]\n{text}\n")
        (tmp_path / "brighter.py").write_text(broken, encoding="utf-8")
        refused = run("fit", text.partition(" ")[0], *folders, "--out", str(tmp_path / "c"))
        assert (refused.returncode, refused.stderr.count("\n")) == (2, 1)
        assert message in refused.stderr


@pytest.mark.parametrize("name", ["mkl", "unit"])
def test_the_lower_rows_are_fitted_and_translated_alone(name):
    source, target = unpaired()
    start = source.size[0] * 3 // 4
    options = {"channels": "2", "blocks": "1"} if METHODS[name].learned else {}
    settings = FitSettings(steps=2, options=options)
    lower = (
        find_method(name)
        .fit(source, target, FitSettings(steps=2, options=options, lower=0.25))
        .translator
    )
    alone = (
        find_method(name)
        .fit(image_set(source.images[:, start:]), image_set(target.images[:, start:]), settings)
        .translator
    )
    images = counterparts(3)[0]
    translated = lower.translate(images)
    assert (translated[:, :start] == images[:, :start]).all()
    assert (translated[:, start:] == alone.translate(images[:, start:])).all()
    stored = encode(StoredTranslator(lower, "a", "b", source.size))
    assert (decode(stored, "file").translator.translate(images) == translated).all()


@pytest.mark.parametrize("lower", [0, -1, 2])
def test_files_with_a_wrong_share_of_rows_are_refused(lower):
    translator = find_method("mkl").fit(*unpaired(), FitSettings(lower=0.5)).translator
    content = encode(StoredTranslator(translator, "a", "b", (32, 32)))
    changed = content.replace(b'\\"lower\\": 0.5', f'\\"lower\\": {lower}'.encode()[:14].ljust(14))
    assert changed != content
    with pytest.raises(RequestError, match="file"):
        decode(changed, "file")
