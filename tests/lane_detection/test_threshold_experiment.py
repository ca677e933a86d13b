"""The threshold experiment: splits without leaks, arms, verdicts, and the command."""

import json
from dataclasses import replace

import numpy as np
import pytest

from s2rtools.lane_detection.arm_evaluation import Evaluation
from s2rtools.lane_detection.experiment_arms import (
    Arm,
    TranslatorCache,
    arms_of,
    parse_sources,
)
from s2rtools.lane_detection.experiment_data import split_images
from s2rtools.lane_detection.line_scores import mean_f1
from s2rtools.lane_detection.threshold_experiment import sim_thresholds
from s2rtui.cli import main


def test_recordings_for_fitting_are_never_judged(rendered):
    split = split_images(rendered)
    judged = set(rendered.sequences[split.judged])
    for light in split.lights:
        for scope in ("light", "all", "others"):
            assert not judged & set(rendered.sequences[split.fit_rows(light, scope)])
        assert light not in rendered.conditions[split.fit_rows(light, "others")]


def test_labels_for_tuning_never_come_from_judged_images(rendered):
    for images in (rendered, replace(rendered, sequences=rendered.conditions)):
        split = split_images(images)
        judged = np.concatenate([part.judged for part in split.parts])
        assert sorted(judged) == list(split.judged)
        for part in split.parts:
            assert not set(part.judged) & set(part.tuned)
            together = [each.judged for each in split.parts if each.half == part.half]
            assert not set(np.concatenate(together)) & set(split.tuning_rows(part))


def test_levels_recover_the_dark_without_labels(rendered, tmp_path):
    sim = rendered.rows(rendered.conditions == "day")
    split = split_images(rendered.rows(rendered.conditions == "dark"))
    cache = TranslatorCache(tmp_path)
    evaluation = Evaluation(split, sim, cache, sim_thresholds(sim))
    arms = arms_of(parse_sources("levels"), 1)
    alone = mean_f1(evaluation.arm(Arm("sim")).pixels.sum(axis=0))
    through = evaluation.arm(next(arm for arm in arms if arm.thresholds == "sim" and arm.source))
    oracle = mean_f1(evaluation.oracle(per_light=True).pixels.sum(axis=0))
    assert mean_f1(through.pixels.sum(axis=0)) > alone + 0.3
    assert oracle > alone
    assert list(tmp_path.glob("levels-*.safetensors"))
    again = Evaluation(split, sim, TranslatorCache(tmp_path), sim_thresholds(sim))
    repeated = again.arm(next(arm for arm in arms if arm.thresholds == "sim" and arm.source))
    assert np.array_equal(through.pixels, repeated.pixels)


def test_report_writes_table_rows_figure_and_words(rendered_folder, tmp_path, capsys):
    out = tmp_path / "results"
    arguments = ["thresholds", "report", "--sim", str(rendered_folder), "--real",
                 str(rendered_folder), "--translators", "levels", "--seeds", "1",
                 "--out", str(out), "--json"]  # fmt: skip
    assert main(arguments) == 0
    document = json.loads(capsys.readouterr().out)
    assert document == json.loads((out / "report.json").read_text())
    names = {row["arm"] for row in document["arms"]}
    assert {"default+ai", "sim", "levels (light) > sim", "levels (others) > sim",
            "sim2real levels (light)", "oracle per light", document["chosen"]} <= names  # fmt: skip
    for row in document["arms"]:
        if row["f1_low"] is not None:
            assert 0 <= row["f1_low"] <= row["f1_high"] <= 1
    by_group = {each["group"]: each for each in document["verdicts"] if each["colour"] == "all"}
    whole = by_group["all"]
    assert whole["spared"] is (whole["high"] >= whole["oracle"])
    assert whole["recordings"] == 2
    assert by_group["dark"]["recordings"] == 1
    assert by_group["dark"]["spared"] is None
    assert (out / "figure.png").read_bytes().startswith(b"\x89PNG")
    assert len((out / "arms.csv").read_text().splitlines()) == len(document["arms"]) + 1
    assert "calibration" in (out / "summary.txt").read_text()


def test_tune_prints_ranges_as_yaml_and_json(rendered_folder, capsys):
    assert main(["thresholds", "tune", str(rendered_folder), "--condition", "day"]) == 0
    text = capsys.readouterr().out
    assert all(f"  {colour}:" in text for colour in ("WHITE", "YELLOW", "RED"))
    assert main(["thresholds", "tune", str(rendered_folder), "--images", "2", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["images"] == 2


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("tune FOLDER --condition moon", "moon"),
        ("tune /nowhere", "no such folder"),
        ("render --out FOLDER", "not empty"),
        ("render --out NEW --frames 0", "--frames"),
        ("report --sim FOLDER --real FOLDER --seeds 0", "--seeds"),
    ],
)
def test_wrong_requests_end_in_one_line(rendered_folder, tmp_path, capsys, arguments, message):
    text = arguments.replace("FOLDER", str(rendered_folder)).replace("NEW", str(tmp_path / "new"))
    assert main(["thresholds", *text.split()]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
