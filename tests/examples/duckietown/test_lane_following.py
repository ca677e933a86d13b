"""The lane-following loop in simulation, and what a translator before the detector changes."""

from dataclasses import replace

import numpy as np
import pytest

from examples.duckietown.conditions import CONDITIONS, Condition
from examples.duckietown.lane_following import (
    CAMERA,
    DriveSettings,
    compare,
    follow_lane,
    tuned_thresholds,
)
from examples.duckietown.line_detector import Thresholds
from examples.duckietown.rendered_folder import lit_frames
from s2rtools.translation.colour_maps import MklTranslator
from s2rtools.translation.colour_statistics import moments

DAY = CONDITIONS["day"]
BLUE = replace(DAY, name="blue", lamp=(0.12, 0.3, 1.4), exposure=0.5)
SHORT = DriveSettings(distance=0.8, period=0.15)


@pytest.fixture(scope="module")
def thresholds() -> Thresholds:
    return tuned_thresholds(DAY, 900, 8)


def translator(source: Condition) -> MklTranslator:
    of = [
        moments(np.stack([frame.rgb for frame in lit_frames([light], 6, 901, camera=CAMERA)]))
        for light in (DAY, source)
    ]
    return MklTranslator(of[0], of[1])


def test_the_robot_stays_in_the_lane_by_day(thresholds):
    drive = follow_lane(DAY, 0, thresholds, settings=SHORT)
    assert drive.kept
    assert drive.detected > 0.9
    assert drive.mean_error < 0.05


def test_a_translator_restores_the_drive_in_coloured_light(thresholds):
    without, with_translator = compare([BLUE], [0], translator(BLUE), thresholds, settings=SHORT)
    before, after = without.summary(), with_translator.summary()
    assert (before["translated"], after["translated"]) == (False, True)
    assert after["kept"] == 1
    assert after["detected"] > before["detected"] + 0.2
