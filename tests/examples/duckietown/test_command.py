"""The commands of the study."""

import csv
import json

import numpy as np
import pytest

from examples.duckietown.__main__ import main
from examples.duckietown.conditions import CONDITIONS
from examples.duckietown.rendered_folder import lit_frames
from s2rtools.translation.colour_maps import IdentityTranslator
from s2rtools.translation.translator_file import StoredTranslator, encode
from tests.support.image_bags import START, write_image_bag


@pytest.fixture
def unchanged(tmp_path):
    """A translator file that changes nothing."""
    path = tmp_path / "identity.safetensors"
    path.write_bytes(encode(StoredTranslator(IdentityTranslator(), "real", "sim", (80, 160))))
    return path


def test_the_study_judges_real_images_and_rendered_lights(rendered_folder, tmp_path, capsys):
    out = tmp_path / "results"
    arguments = ["study", "--sim", str(rendered_folder), "--real", str(rendered_folder),
                 "--light-frames", "0", "--translators", "levels", "--seeds", "1",
                 "--out", str(out), "--json"]  # fmt: skip
    assert main(arguments) == 0
    document = json.loads(capsys.readouterr().out)[rendered_folder.name]
    results = out / rendered_folder.name
    assert document == json.loads((results / "report.json").read_text())
    names = {row["variant"] for row in document["variants"]}
    assert {"default+ai", "sim", "levels (light) > sim", "levels (others) > sim",
            "sim2real levels (light)", "oracle per light", document["chosen"]} <= names  # fmt: skip
    for row in document["variants"]:
        if row["f1_low"] is not None:
            assert 0 <= row["f1_low"] <= row["f1_high"] <= 1
    by_group = {each["group"]: each for each in document["verdicts"] if each["colour"] == "all"}
    whole = by_group["all"]
    assert whole["spared"] is (whole["high"] >= whole["oracle"])
    assert (whole["recordings"], by_group["dark"]["recordings"]) == (2, 1)
    assert by_group["dark"]["spared"] is None
    assert (results / "figure.png").read_bytes().startswith(b"\x89PNG")
    assert len((results / "variants.csv").read_text().splitlines()) == len(document["variants"]) + 1
    assert "calibration" in (results / "summary.txt").read_text()


def test_tune_prints_ranges_as_yaml_and_json(rendered_folder, capsys):
    assert main(["tune", str(rendered_folder), "--condition", "day"]) == 0
    text = capsys.readouterr().out
    assert all(f"  {colour}:" in text for colour in ("WHITE", "YELLOW", "RED"))
    assert main(["tune", str(rendered_folder), "--images", "2", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["images"] == 2


def test_segments_lists_the_lines_of_every_image_of_a_bag(tmp_path, unchanged, capsys):
    lit = next(iter(lit_frames([CONDITIONS["day"]], 1, seed=3))).rgb
    bag = write_image_bag(tmp_path / "a.bag", [lit, np.full_like(lit, 60)])
    table = tmp_path / "segments.csv"
    arguments = ["segments", str(bag), "--translator", str(unchanged), "--segments", str(table),
                 "--out", str(tmp_path / "b.bag")]  # fmt: skip
    assert main(arguments) == 0
    with table.open() as file:
        rows = list(csv.DictReader(file))
    assert {int(row["stamp_ns"]) for row in rows} == {START}
    assert {"white", "yellow"} <= {row["colour"] for row in rows}
    assert all(0 <= float(row["x1"]) < 160 and 0 <= float(row["y2"]) < 80 for row in rows)
    assert f"{len(rows)} segments in 2 images" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("tune FOLDER --condition moon", "moon"),
        ("tune /nowhere", "no such folder"),
        ("render --out FOLDER", "not empty"),
        ("render --out NEW --frames 0", "--frames"),
        ("study --out NEW --sim FOLDER --real FOLDER --seeds 0", "--seeds"),
        ("study --out NEW --sim FOLDER --light-frames 0", "nothing to judge"),
        ("study --out NEW --sim FOLDER --real FOLDER --translators magic", "'magic'"),
        ("drive --translator NEW --condition moon", "moon"),
    ],
)
def test_wrong_requests_end_in_one_line(rendered_folder, tmp_path, capsys, arguments, message):
    text = arguments.replace("FOLDER", str(rendered_folder)).replace("NEW", str(tmp_path / "new"))
    assert main(text.split()) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
