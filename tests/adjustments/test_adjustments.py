"""Image adjustments: neutral values, chains, and the effect of each adjustment."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from s2rstore.errors import RequestError
from s2rstore.geometry import camera_offset
from s2rstore.records import SIDES
from s2rtools.adjustments import (
    ADJUSTMENTS,
    ImageAdjustment,
    RenderedAdjustment,
    TranslatorAdjustment,
    apply_chain,
    make_chain,
    parse_adjustment,
)

WITH_NUMBERS = [
    name for name, entry in ADJUSTMENTS.items() if not isinstance(entry, TranslatorAdjustment)
]


@pytest.fixture(params=[np.uint8, np.uint16])
def frames(request):
    rng = np.random.default_rng(1)
    rgb = rng.integers(0, 256, (4, 32, 32, 3), dtype=np.uint8)
    depth = rng.integers(0, 256, (4, 32, 32)).astype(request.param)
    return rgb, depth, (depth > 5) & (depth < 250)


def chain(**values: float) -> list[dict[str, object]]:
    return [{"name": name, "value": value} for name, value in values.items()]


def test_neutral_values_return_the_input_arrays(frames):
    neutral = {name: adjustment.neutral for name, adjustment in ADJUSTMENTS.items()}
    rgb, depth = apply_chain(*frames, chain(**neutral))
    assert rgb is frames[0]
    assert depth is frames[1]
    assert apply_chain(*frames, [])[0] is frames[0]


@pytest.mark.parametrize("name", WITH_NUMBERS)
@pytest.mark.parametrize("limit", ["lowest", "highest"])
def test_types_and_shapes_are_preserved_and_the_input_is_unchanged(frames, name, limit):
    before = [image.copy() for image in frames]
    value = getattr(ADJUSTMENTS[name], limit)
    rgb, depth = apply_chain(*frames, chain(**{name: value}))
    assert (rgb.dtype, rgb.shape) == (frames[0].dtype, frames[0].shape)
    assert (depth.dtype, depth.shape) == (frames[1].dtype, frames[1].shape)
    for image, copy in zip(frames, before, strict=True):
        np.testing.assert_array_equal(image, copy)


@pytest.mark.parametrize("name", ["brightness", "contrast", "temperature"])
def test_colour_adjustments_do_not_change_depth(frames, name):
    rgb, depth = apply_chain(*frames, chain(**{name: ADJUSTMENTS[name].highest}))
    assert depth is frames[1]
    assert not np.array_equal(rgb, frames[0])


@pytest.mark.parametrize("name", ["depth_range", "depth_blur"])
def test_depth_adjustments_change_only_valid_depth(frames, name):
    rgb, depth, valid = frames
    adjusted_rgb, adjusted = apply_chain(rgb, depth, valid, chain(**{name: 2.0}))
    assert adjusted_rgb is rgb
    np.testing.assert_array_equal(adjusted[~valid], depth[~valid])
    assert not np.array_equal(adjusted[valid], depth[valid])


def test_brightness_multiplies_and_saturates(frames):
    rgb, _ = apply_chain(*frames, chain(brightness=1.15))
    np.testing.assert_array_equal(rgb, np.clip(np.rint(frames[0] * 1.15), 0, 255))


def test_zero_contrast_gives_the_mean_of_each_image(frames):
    rgb, _ = apply_chain(*frames, chain(contrast=0.0))
    for image, source in zip(rgb, frames[0], strict=True):
        assert np.unique(image).tolist() == [round(float(source.mean()))]


def test_a_higher_temperature_gives_more_red(frames):
    rgb, _ = apply_chain(*frames, chain(temperature=0.5))
    assert rgb[..., 0].mean() > frames[0][..., 0].mean()
    assert rgb[..., 2].mean() < frames[0][..., 2].mean()


def test_blur_of_flat_depth_ignores_holes():
    depth = np.full((1, 20, 20), 100, dtype=np.uint8)
    depth[0, 8:12, 8:12] = 0
    valid = depth > 5
    _, adjusted = apply_chain(
        np.zeros((1, 20, 20, 3), np.uint8), depth, valid, chain(depth_blur=3.0)
    )
    np.testing.assert_array_equal(adjusted, depth)


def test_steps_apply_in_order(frames):
    rgb, depth, valid = frames
    once = apply_chain(rgb, depth, valid, chain(brightness=1.5))
    twice = apply_chain(*once, valid, chain(contrast=0.5))
    both = apply_chain(rgb, depth, valid, chain(brightness=1.5, contrast=0.5))
    np.testing.assert_array_equal(both[0], twice[0])


def test_images_of_a_batch_are_adjusted_independently(frames):
    steps = chain(contrast=1.4, depth_blur=2.0)
    rgb, depth = apply_chain(*frames, steps)
    for index in range(len(rgb)):
        single = apply_chain(*(image[index : index + 1] for image in frames), steps)
        np.testing.assert_array_equal(single[0][0], rgb[index])
        np.testing.assert_array_equal(single[1][0], depth[index])


def test_adjustments_are_parsed_from_the_command_line():
    assert parse_adjustment("real:brightness=1.15, contrast=1.1") == {
        "sim": [],
        "real": chain(brightness=1.15, contrast=1.1),
    }
    assert parse_adjustment("sim:black") == {"sim": chain(black=1.0), "real": []}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("brightness=1.1", "sim: or real:"),
        ("both:brightness=1.1", "sim: or real:"),
        ("real:brighness=1.1", "brightness"),
        ("real:brightness=9", r"0 \.\. 3"),
        ("real:brightness=nan", r"0 \.\. 3"),
        ("real:brightness=much", "not a number"),
        ("real:", "one of translate, brightness"),
        ("sim:camera_height", "needs a value, such as camera_height=0.02"),
        ("sim:camera_pitch=31", r"-30 \.\. 30 \(degrees\)"),
    ],
)
def test_invalid_adjustments_list_the_valid_values(text, message):
    with pytest.raises(RequestError, match=message):
        parse_adjustment(text)


def test_the_registry_describes_every_slider():
    for name, adjustment in ADJUSTMENTS.items():
        assert adjustment.name == name
        assert adjustment.lowest <= adjustment.neutral <= adjustment.highest
        steps = (adjustment.highest - adjustment.lowest) / adjustment.step
        assert 10 <= steps <= 200
        assert steps == pytest.approx(round(steps))
        assert adjustment.unit
        assert adjustment.description
        assert set(adjustment.sides) <= set(SIDES)
        kinds = (ImageAdjustment, RenderedAdjustment, TranslatorAdjustment)
        assert sum(isinstance(adjustment, kind) for kind in kinds) == 1
        assert adjustment.needs_renderer == isinstance(adjustment, RenderedAdjustment)
    rendered = [name for name, entry in ADJUSTMENTS.items() if entry.needs_renderer]
    assert tuple(rendered) == camera_offset.NAMES


def test_camera_adjustments_do_not_change_images(frames):
    rgb, depth = apply_chain(*frames, chain(camera_height=0.3, camera_pitch=-4, camera_fov=10))
    assert rgb is frames[0]
    assert depth is frames[1]


@given(
    st.dictionaries(st.sampled_from(WITH_NUMBERS), st.floats(0, 1), max_size=5),
    st.sampled_from(SIDES),
)
def test_slider_values_give_the_chain_of_the_command_line(shares, side):
    values = {}
    for name, share in shares.items():
        low, high = ADJUSTMENTS[name].lowest, ADJUSTMENTS[name].highest
        values[name] = round(low + share * (high - low), 3)
    chain_of_values = make_chain(side, values)
    assert [step["name"] for step in chain_of_values] == [
        name for name in ADJUSTMENTS if values.get(name, ADJUSTMENTS[name].neutral)
        != ADJUSTMENTS[name].neutral
    ]  # fmt: skip
    if chain_of_values:
        text = ",".join(f"{step['name']}={step['value']!r}" for step in chain_of_values)
        assert parse_adjustment(f"{side}:{text}")[side] == chain_of_values


def test_values_out_of_range_are_rejected():
    with pytest.raises(RequestError, match=r"brightness=4: allowed are 0 \.\. 3"):
        make_chain("real", {"brightness": 4.0})
    with pytest.raises(RequestError, match="one of translate, brightness"):
        make_chain("real", {"glow": 1.0})


def test_a_vignette_darkens_the_corners_and_keeps_the_centre():
    rgb = np.full((1, 33, 33, 3), 200, dtype=np.uint8)
    depth = np.ones((1, 33, 33), dtype=np.uint16)
    dark, same = apply_chain(rgb, depth, depth > 0, chain(vignette=0.3))
    assert same is depth
    assert (dark[0, 16, 16] == 200).all()
    assert dark[0, 0, 0, 0] == pytest.approx(200 * 0.7, abs=4)
    assert (np.diff(dark[0, 16, 16:, 0].astype(int)) <= 0).all()


def test_depth_noise_is_a_share_of_the_depth_and_repeats():
    rgb = np.zeros((2, 48, 48, 3), dtype=np.uint8)
    depth = np.full((2, 48, 48), 4000, dtype=np.uint16)
    depth[:, :5] = 0
    noisy = [apply_chain(rgb, depth, depth > 0, chain(depth_noise=0.02))[1] for _ in range(2)]
    np.testing.assert_array_equal(*noisy)
    assert (noisy[0][:, :5] == 0).all()
    assert noisy[0][:, 5:].std() / 4000 == pytest.approx(0.02, rel=0.1)


def test_depth_holes_remove_their_share_of_the_valid_depth():
    u = np.linspace(1000, 5000, 64)
    depth = np.broadcast_to(u, (2, 64, 64)).astype(np.uint16).copy()
    depth[:, :10] = 0
    rgb = np.zeros((2, 64, 64, 3), dtype=np.uint8)
    holes = apply_chain(rgb, depth, depth > 0, chain(depth_holes=0.2))[1]
    lost = (depth > 0) & (holes == 0)
    assert lost.sum() / (depth > 0).sum() == pytest.approx(0.2, abs=0.02)
    np.testing.assert_array_equal(holes[~lost], depth[~lost])
