"""Translators of the lower rows alone."""

import pytest

from s2rstore.errors import RequestError
from s2rtools.translation import METHODS
from s2rtools.translation.method import FitSettings
from s2rtools.translation.translator_file import StoredTranslator, decode, encode
from tests.translation.palette_world import counterparts, image_set, unpaired


@pytest.mark.parametrize("name", ["mkl", "unit"])
def test_the_lower_rows_are_fitted_and_translated_alone(name):
    source, target = unpaired()
    start = source.size[0] * 3 // 4
    options = {"channels": "2", "blocks": "1"} if METHODS[name].learned else {}
    settings = FitSettings(steps=2, options=options)
    lower = (
        METHODS.find(name)
        .fit(source, target, FitSettings(steps=2, options=options, lower=0.25))
        .translator
    )
    alone = (
        METHODS.find(name)
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
    translator = METHODS.find("mkl").fit(*unpaired(), FitSettings(lower=0.5)).translator
    content = encode(StoredTranslator(translator, "a", "b", (32, 32)))
    changed = content.replace(b'\\"lower\\": 0.5', f'\\"lower\\": {lower}'.encode()[:14].ljust(14))
    assert changed != content
    with pytest.raises(RequestError, match="file"):
        decode(changed, "file")
