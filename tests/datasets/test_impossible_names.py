"""A name that no file can have is that of a missing image, in whatever source it stands."""

import pytest

import s2rstore
from s2rstore.errors import RequestError
from s2rtools.datasets.files.path_containment import PathContainment
from s2rtui.cli import main
from tests.support import pairs

TOO_LONG = "a" * 100_000 + ".png"


def test_a_manifest_with_a_too_long_name_loses_that_pair(tmp_path, capsys):
    manifest = pairs.manifest(tmp_path / "data", n=3)
    text = manifest.read_text().replace("sim/1_rgb.png", TOO_LONG)
    manifest.write_text(text)
    store = tmp_path / "s.s2r"
    assert main(["ingest", "csv", str(manifest), "--store", str(store), "--size", "32"]) == 0
    errors = capsys.readouterr().err
    assert "missing image: 1\n  aaa" in errors
    assert len(errors) < 2000
    with s2rstore.open(store) as opened:
        assert len(opened.instances) == 2


@pytest.mark.parametrize(
    "name",
    [TOO_LONG, "a/" * 50_000, "a\0b", "\0/b", "\ud800"],
    ids=["long", "deep", "nul", "nul folder", "surrogate"],
)
def test_a_name_that_no_file_can_have_is_not_found_and_not_repeated_in_full(tmp_path, name):
    containment = PathContainment(tmp_path)
    assert containment.find_file(name, "list.txt:3") is None
    with pytest.raises(RequestError, match=r"list\.txt:3: .* is not a file name") as error:
        containment.resolve(name, "list.txt:3")
    assert len(str(error.value)) < 300
