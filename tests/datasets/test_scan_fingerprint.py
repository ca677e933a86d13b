"""The fingerprint of a scan changes with what its frames depend on."""

import os
from pathlib import Path

from s2rtools.datasets.writing.scan_fingerprint import fingerprint
from tests.datasets.helpers import scan_of
from tests.support import pairs


def test_equal_scans_have_one_fingerprint_and_other_sources_another(tmp_path):
    manifest = pairs.manifest(tmp_path / "data", n=4)
    found = {fingerprint(scan_of("csv", manifest)) for _ in range(2)}
    assert len(found) == 1
    image = tmp_path / "data" / "real" / "2_depth.png"
    state = image.stat()
    os.utime(image, ns=(state.st_atime_ns, state.st_mtime_ns + 1))
    found.add(fingerprint(scan_of("csv", manifest)))
    os.utime(image, ns=(state.st_atime_ns, state.st_mtime_ns))
    image.write_bytes(image.read_bytes() + b"0")
    os.utime(image, ns=(state.st_atime_ns, state.st_mtime_ns))
    found.add(fingerprint(scan_of("csv", manifest)))
    found.add(fingerprint(scan_of("csv", manifest, frame=(48, 48))))
    found.add(fingerprint(scan_of("csv", manifest, trajectories=("a",))))
    header = manifest.with_suffix(".toml")
    header.write_text(header.read_text().replace("depth_raw_max = 249", "depth_raw_max = 248"))
    found.add(fingerprint(scan_of("csv", manifest)))
    assert None not in found
    assert len(found) == 6


def test_the_fingerprint_of_a_world_is_that_of_its_recipe():
    found = [
        fingerprint(scan_of("world", Path(), frame=(32, 32), world={"count": 3, "seed": seed}))
        for seed in (1, 1, 2)
    ]
    assert found[0] is not None
    assert found[0] == found[1]
    assert found[0] != found[2]


def test_a_source_of_unknown_origin_has_no_fingerprint(tmp_path):
    scan = scan_of("csv", pairs.manifest(tmp_path / "data", n=4))
    records = scan.trajectories["a"]
    scan.trajectories["a"] = list(records)
    scan.trajectories["a"][0].sources["sim"] = object()  # type: ignore[index]
    assert fingerprint(scan) is None
