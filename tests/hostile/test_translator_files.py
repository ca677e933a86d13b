"""Translator files that are damaged or made to harm end in one line that names the file."""

import json
import struct
from typing import Any

import numpy as np
import pytest
from safetensors.numpy import save

from s2rstore.errors import RequestError
from s2rtools.translation import METHODS
from s2rtools.translation.depth_noise import BINS
from s2rtools.translation.image_set import ImageSet
from s2rtools.translation.method import FitSettings
from s2rtools.translation.translator_file import StoredTranslator, decode, encode, read_translator

STATISTICAL = [name for name, method in METHODS.items() if not method.learned]


def file(method: str, tensors: dict[str, Any], settings: Any = None, **header: Any) -> bytes:
    """A file of tensors and header."""
    fields = {
        "format": 1, "method": method, "version": METHODS[method].version if method in METHODS
        else 1, "source": "a", "target": "b", "size": [16, 16], "settings": settings or {},
    } | header  # fmt: skip
    return save(tensors or {"empty": np.zeros(1)}, {"translator": json.dumps(fields)})


def assert_refused(content: bytes) -> None:
    with pytest.raises(RequestError) as caught:
        decode(content, "a.safetensors")
    assert str(caught.value).startswith("a.safetensors: ")
    assert "\n" not in str(caught.value)


def fitted(name: str) -> bytes:
    rng = np.random.default_rng(0)
    images = rng.integers(0, 256, (3, 16, 16, 3), dtype=np.uint8)
    image_set = ImageSet("images", images, np.zeros(3, dtype=np.int32), ("a", "b", "c"))
    translator = METHODS[name].fit(image_set, image_set, FitSettings()).translator
    return encode(StoredTranslator(translator, "a", "b", (16, 16)))


@pytest.mark.parametrize("name", STATISTICAL)
def test_files_that_are_cut_off_are_refused(name):
    content = fitted(name)
    decode(content, "file")
    for length in (0, 1, 8, 9, 100, len(content) // 2, len(content) - 1):
        assert_refused(content[:length])


@pytest.mark.parametrize(
    "content",
    [
        b"\xff" * 8 + b"{}",
        struct.pack("<Q", 2) + b"[]",
        struct.pack("<Q", 200_000) + b"[" * 200_000,
        save({"target": np.zeros(3)}),
        save({"target": np.zeros(3)}, {"translator": "{"}),
        save({"target": np.zeros(3)}, {"translator": '{"format": 1}'}),
        file("grayworld", {"target": np.zeros(3)}, more=1),
        file("grayworld", {"target": np.zeros(3)}, format=2),
        file("grayworld", {"target": np.zeros(3)}, version=99),
        file("grayworld", {"target": np.zeros(3)}, size=[8, 10**15]),
        file("vangogh", {"target": np.zeros(3)}),
    ],
    ids=range(11),
)
def test_wrong_headers_are_refused(content):
    assert_refused(content)


def declaring(kind: str, shape: list[int]) -> bytes:
    """A file with 24 bytes of tensors that declares another type or shape of them."""
    content = file("grayworld", {"target": np.zeros(3)})
    length = struct.unpack_from("<Q", content)[0]
    header = json.loads(content[8 : 8 + length])
    header["target"] |= {"dtype": kind, "shape": shape}
    encoded = json.dumps(header).encode()
    return struct.pack("<Q", len(encoded)) + encoded + content[8 + length :]


@pytest.mark.parametrize(
    ("kind", "shape"),
    [("F64", [10**12]), ("F64", [2**62, 4]), ("F64", [-3]), ("BF16", [12]), ("X9", [3])],
)
def test_declared_tensors_that_do_not_fit_the_file_are_refused(kind, shape):
    assert decode(declaring("F64", [3]), "file").method == "grayworld"
    assert_refused(declaring(kind, shape))


PERCENTILES = {"low": 40.0, "high": 97.0, "rows": 0.7}
MOMENTS = np.vstack([np.zeros(3), np.eye(3)])


@pytest.mark.parametrize(
    ("method", "tensors", "settings"),
    [
        ("fda", {"amplitude": np.array(1.0)}, {}),
        ("fda", {"amplitude": np.ones((3, 3, 3), dtype=np.complex64)}, {}),
        ("grayworld", {"target": np.zeros(4)}, {}),
        ("grayworld", {"target": np.array([1, np.nan, 1])}, {}),
        ("grayworld", {"median": np.zeros(3)}, {}),
        ("levels", {"target": np.ones(6)}, PERCENTILES | {"low": "nan"}),
        ("levels", {"target": np.ones(6)}, PERCENTILES | {"low": 98.0}),
        ("levels", {"target": np.ones(6)}, PERCENTILES | {"rows": 0}),
        ("levels", {"target": np.ones(5)}, PERCENTILES),
        ("reinhard", {"target": np.full((2, 3), np.inf)}, {}),
        ("histogram", {"target": np.ones((3, 255))}, {}),
        ("mkl", {"target": np.full((4, 3), 1e308)}, {}),
        ("mkl", {"target": np.vstack([np.zeros(3), np.triu(np.ones((3, 3)))])}, {}),
        ("mkl", {"source": MOMENTS}, {}),
    ],
    ids=range(14),
)
def test_tensors_and_settings_that_define_no_translator_are_refused(method, tensors, settings):
    assert_refused(file(method, tensors, settings))


@pytest.mark.parametrize(
    ("figures", "spread", "edges"),
    [
        ([2.0, 9, 0], np.zeros(BINS), np.arange(BINS + 1.0)),
        ([0.5, -9, 0], np.zeros(BINS), np.arange(BINS + 1.0)),
        ([0.5, 9, 0], np.full(BINS, -1.0), np.arange(BINS + 1.0)),
        ([0.5, 9, 0], np.zeros(BINS), np.arange(BINS + 1.0)[::-1].copy()),
        ([0.5, 9, 0], np.zeros(3), np.arange(BINS + 1.0)),
        ([0.5, 9, np.nan], np.zeros(BINS), np.arange(BINS + 1.0)),
    ],
    ids=range(6),
)
def test_depth_noise_out_of_range_is_refused(figures, spread, edges):
    noise = {"figures": np.array(figures), "spread": spread, "edges": edges}
    tensors = {f"depth_noise/{name}": array for name, array in noise.items()}
    assert_refused(file("grayworld", {"target": np.zeros(3)} | tensors))


def test_a_network_whose_images_are_not_finite_is_refused():
    rng = np.random.default_rng(0)
    images = rng.integers(0, 256, (1, 16, 16, 3), dtype=np.uint8)
    image_set = ImageSet("images", images, np.zeros(1, dtype=np.int32), ("a",))
    options = {"channels": "1", "blocks": "1"}
    settings = FitSettings(steps=0, options=options)
    translator = METHODS["mkl+residual"].fit(image_set, image_set, settings).translator
    tensors = {name: np.full_like(array, 9e8) for name, array in translator.tensors().items()}
    decode(file("mkl+residual", translator.tensors(), translator.settings()), "file")
    assert_refused(file("mkl+residual", tensors, translator.settings()))


def test_files_that_are_no_translator_are_named(tmp_path):
    with pytest.raises(RequestError, match="no-such"):
        read_translator(tmp_path / "no-such.safetensors")
    with pytest.raises(RequestError, match="a folder"):
        read_translator(tmp_path)
