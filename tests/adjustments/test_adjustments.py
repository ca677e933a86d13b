"""Adjustments: neutral to the bit, chained, and what each one changes."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from s2rstore.errors import RequestError
from s2rstore.geometry import camera_offset
from s2rstore.records import SIDES
from s2rtools.adjustments import (
    ADJUSTMENTS,
    ImageAdjustment,
    apply_chain,
    make_chain,
    parse_adjustment,
)
from s2rtools.models import build_network
from s2rtools.models.preprocessing import preprocess


@pytest.fixture(params=[np.uint8, np.uint16])
def frames(request):
    rng = np.random.default_rng(1)
    rgb = rng.integers(0, 256, (4, 32, 32, 3), dtype=np.uint8)
    depth = rng.integers(0, 256, (4, 32, 32)).astype(request.param)
    return rgb, depth, (depth > 5) & (depth < 250)


def chain(**values: float) -> list[dict[str, object]]:
    return [{"name": name, "value": value} for name, value in values.items()]


def test_neutral_values_give_the_very_same_arrays(frames):
    neutral = {name: adjustment.neutral for name, adjustment in ADJUSTMENTS.items()}
    rgb, depth = apply_chain(*frames, chain(**neutral))
    assert rgb is frames[0]
    assert depth is frames[1]
    assert apply_chain(*frames, [])[0] is frames[0]


@pytest.mark.parametrize("name", list(ADJUSTMENTS))
@pytest.mark.parametrize("end", ["lowest", "highest"])
def test_types_and_shapes_stay_and_the_input_is_not_touched(frames, name, end):
    before = [image.copy() for image in frames]
    value = getattr(ADJUSTMENTS[name], end)
    rgb, depth = apply_chain(*frames, chain(**{name: value}))
    assert (rgb.dtype, rgb.shape) == (frames[0].dtype, frames[0].shape)
    assert (depth.dtype, depth.shape) == (frames[1].dtype, frames[1].shape)
    for image, copy in zip(frames, before, strict=True):
        np.testing.assert_array_equal(image, copy)


@pytest.mark.parametrize("name", ["brightness", "contrast", "temperature"])
def test_colour_adjustments_leave_depth_alone(frames, name):
    rgb, depth = apply_chain(*frames, chain(**{name: ADJUSTMENTS[name].highest}))
    assert depth is frames[1]
    assert not np.array_equal(rgb, frames[0])


@pytest.mark.parametrize("name", ["depth_range", "depth_blur"])
def test_depth_adjustments_leave_colour_and_invalid_depth_alone(frames, name):
    rgb, depth, valid = frames
    made_rgb, made = apply_chain(rgb, depth, valid, chain(**{name: 2.0}))
    assert made_rgb is rgb
    np.testing.assert_array_equal(made[~valid], depth[~valid])
    assert not np.array_equal(made[valid], depth[valid])


def test_brightness_multiplies_and_saturates(frames):
    rgb, _ = apply_chain(*frames, chain(brightness=1.15))
    np.testing.assert_array_equal(rgb, np.clip(np.rint(frames[0] * 1.15), 0, 255))


def test_contrast_zero_is_each_images_own_mean(frames):
    rgb, _ = apply_chain(*frames, chain(contrast=0.0))
    for image, source in zip(rgb, frames[0], strict=True):
        assert np.unique(image).tolist() == [round(float(source.mean()))]


def test_warmer_means_redder(frames):
    rgb, _ = apply_chain(*frames, chain(temperature=0.5))
    assert rgb[..., 0].mean() > frames[0][..., 0].mean()
    assert rgb[..., 2].mean() < frames[0][..., 2].mean()


def test_blur_of_flat_depth_ignores_holes():
    depth = np.full((1, 20, 20), 100, dtype=np.uint8)
    depth[0, 8:12, 8:12] = 0
    valid = depth > 5
    _, made = apply_chain(np.zeros((1, 20, 20, 3), np.uint8), depth, valid, chain(depth_blur=3.0))
    np.testing.assert_array_equal(made, depth)


def test_steps_apply_in_order(frames):
    rgb, depth, valid = frames
    once = apply_chain(rgb, depth, valid, chain(brightness=1.5))
    twice = apply_chain(*once, valid, chain(contrast=0.5))
    both = apply_chain(rgb, depth, valid, chain(brightness=1.5, contrast=0.5))
    np.testing.assert_array_equal(both[0], twice[0])


def test_each_image_is_adjusted_as_if_alone(frames):
    steps = chain(contrast=1.4, depth_blur=2.0)
    rgb, depth = apply_chain(*frames, steps)
    for index in range(len(rgb)):
        alone = apply_chain(*(image[index : index + 1] for image in frames), steps)
        np.testing.assert_array_equal(alone[0][0], rgb[index])
        np.testing.assert_array_equal(alone[1][0], depth[index])


@pytest.mark.parametrize("architecture", ["posest", "resposenet"])
def test_black_gives_one_constant_prediction(frames, architecture):
    network = build_network(architecture).eval()
    rgb, depth = apply_chain(*frames, chain(black=1.0))
    x = preprocess(rgb, depth, 10 / 255, network.input_size)
    assert np.unique(x).tolist() == [-1.0]
    with torch.inference_mode():
        output = network(torch.from_numpy(x))
    torch.testing.assert_close(output, output[:1].expand_as(output), rtol=1e-5, atol=1e-5)


def test_the_command_line_form():
    assert parse_adjustment("real:brightness=1.15, contrast=1.1") == {
        "sim": [],
        "real": chain(brightness=1.15, contrast=1.1),
    }
    assert parse_adjustment("sim:black") == {"sim": chain(black=1.0), "real": []}


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("brightness=1.1", "sim: or real:"),
        ("both:brightness=1.1", "sim: or real:"),
        ("real:brighness=1.1", "brightness"),
        ("real:brightness=9", r"0 \.\. 3"),
        ("real:brightness=nan", r"0 \.\. 3"),
        ("real:brightness=much", "not a number"),
        ("real:", "one of brightness"),
        ("sim:camera_height", "needs a value, such as camera_height=0.02"),
        ("sim:camera_pitch=31", r"-30 \.\. 30 \(degrees\)"),
    ],
)
def test_wrong_requests_say_what_could_stand_there(text, named):
    with pytest.raises(RequestError, match=named):
        parse_adjustment(text)


def test_the_registry_alone_makes_sliders():
    for name, adjustment in ADJUSTMENTS.items():
        assert adjustment.name == name
        assert adjustment.lowest <= adjustment.neutral <= adjustment.highest
        steps = (adjustment.highest - adjustment.lowest) / adjustment.step
        assert 10 <= steps <= 200
        assert steps == pytest.approx(round(steps))
        assert adjustment.unit
        assert adjustment.description
        assert set(adjustment.sides) <= set(SIDES)
        assert isinstance(adjustment, ImageAdjustment) != adjustment.needs_renderer
    rendered = [name for name, found in ADJUSTMENTS.items() if found.needs_renderer]
    assert tuple(rendered) == camera_offset.NAMES


def test_what_needs_a_renderer_leaves_images_alone(frames):
    rgb, depth = apply_chain(*frames, chain(camera_height=0.3, camera_pitch=-4, camera_fov=10))
    assert rgb is frames[0]
    assert depth is frames[1]


@given(
    st.dictionaries(st.sampled_from(list(ADJUSTMENTS)), st.floats(0, 1), max_size=5),
    st.sampled_from(SIDES),
)
def test_values_make_the_chain_that_the_command_line_makes(shares, side):
    values = {}
    for name, share in shares.items():
        low, high = ADJUSTMENTS[name].lowest, ADJUSTMENTS[name].highest
        values[name] = round(low + share * (high - low), 3)
    made = make_chain(side, values)
    assert [step["name"] for step in made] == [
        name for name in ADJUSTMENTS if values.get(name, ADJUSTMENTS[name].neutral)
        != ADJUSTMENTS[name].neutral
    ]  # fmt: skip
    if made:
        text = ",".join(f"{step['name']}={step['value']!r}" for step in made)
        assert parse_adjustment(f"{side}:{text}")[side] == made


def test_values_out_of_range_are_refused():
    with pytest.raises(RequestError, match=r"brightness=4: allowed are 0 \.\. 3"):
        make_chain("real", {"brightness": 4.0})
    with pytest.raises(RequestError, match="one of brightness"):
        make_chain("real", {"glow": 1.0})
