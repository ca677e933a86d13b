"""Image adjustments: neutral values, chains, and the effect of each adjustment."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from s2rstore.errors import RequestError
from s2rstore.geometry import camera_offset
from s2rstore.records import SIDES, Domain, Intrinsics
from s2rtools.adjustments import (
    ADJUSTMENTS,
    ImageAdjustment,
    RenderedAdjustment,
    TranslatorAdjustment,
    apply_chain,
    make_chain,
    parse_adjustment,
)
from s2rtools.precompute.frame_reader import adjusted_images

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


@pytest.mark.parametrize(
    ("values", "changes_colours", "changes_depth"),
    [
        ({"brightness": 3.0}, True, False), ({"contrast": 3.0}, True, False),
        ({"temperature": 1.0}, True, False), ({"depth_range": 2.0}, False, True),
        ({"depth_blur": 2.0}, False, True),
        ({"camera_height": 0.3, "camera_pitch": -4, "camera_fov": 10}, False, False),
    ],
)  # fmt: skip
def test_an_adjustment_changes_colours_or_valid_depth_alone(
    frames, values, changes_colours, changes_depth
):
    _, depth, valid = frames
    adjusted_rgb, adjusted = apply_chain(*frames, chain(**values))
    assert (adjusted_rgb is not frames[0]) == changes_colours
    assert (adjusted is not depth) == changes_depth
    assert np.array_equal(adjusted_rgb, frames[0]) == (not changes_colours)
    assert np.array_equal(adjusted[valid], depth[valid]) == (not changes_depth)
    np.testing.assert_array_equal(adjusted[~valid], depth[~valid])


def test_colours_are_multiplied_contracted_and_warmed_in_the_order_of_the_steps(frames):
    bright, _ = apply_chain(*frames, chain(brightness=1.15))
    np.testing.assert_array_equal(bright, np.clip(np.rint(frames[0] * 1.15), 0, 255))
    flat, _ = apply_chain(*frames, chain(contrast=0.0))
    for image, source in zip(flat, frames[0], strict=True):
        assert np.unique(image).tolist() == [round(float(source.mean()))]
    warm, _ = apply_chain(*frames, chain(temperature=0.5))
    assert warm[..., 0].mean() > frames[0][..., 0].mean()
    assert warm[..., 2].mean() < frames[0][..., 2].mean()
    both, _ = apply_chain(*frames, chain(brightness=1.15, contrast=0.5))
    one_by_one, _ = apply_chain(bright, *frames[1:], chain(contrast=0.5))
    np.testing.assert_array_equal(both, one_by_one)


def test_blur_of_flat_depth_ignores_holes():
    depth = np.full((1, 20, 20), 100, dtype=np.uint8)
    depth[0, 8:12, 8:12] = 0
    valid = depth > 5
    _, adjusted = apply_chain(
        np.zeros((1, 20, 20, 3), np.uint8), depth, valid, chain(depth_blur=3.0)
    )
    np.testing.assert_array_equal(adjusted, depth)


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


_LENS = Intrinsics(50.0, 50.0, 50.0, 30.0)


def _picture(height: int, width: int):
    """A smooth image, and depth that is missing on the left."""
    rows, columns = np.mgrid[:height, :width]
    rgb = np.stack([rows * 2, columns * 2, rows + columns], axis=2).astype(np.uint8)[None]
    depth = np.full((1, height, width), 2000, dtype=np.uint16)
    depth[:, :, : width // 3] = 0
    return rgb, depth


@pytest.mark.parametrize("value", [-0.14, -0.05, 0.1, 0.3])
def test_distortion_is_the_first_radial_coefficient_of_opencv(value):
    height, width = 60, 100
    rgb, depth = _picture(height, width)
    seen, near = apply_chain(rgb, depth, depth > 0, chain(distortion=value))
    focal = np.hypot(height, width) / 2
    lens = np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]])
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)
    pixels = pixels.reshape(-1, 1, 2).astype(np.float64)
    exact = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 300, 1e-9)
    shown = cv2.undistortImagePoints(pixels, lens, np.array([value, 0, 0, 0]), None, exact)
    shown = shown.reshape(height, width, 2).astype(np.float32)
    expected = cv2.remap(rgb[0], shown[..., 0], shown[..., 1], cv2.INTER_LINEAR)
    inside = (shown >= 0).all(axis=2) & (shown <= [width - 1, height - 1]).all(axis=2)
    np.testing.assert_allclose(seen[0][inside], expected[inside], atol=1)
    border = shown[..., 0] - (width // 3 - 0.5)
    assert (near[0][inside & (border > 0.01)] == 2000).all()
    assert (near[0][border < -0.01] == 0).all()


def test_pixels_that_a_lens_moves_take_their_validity_along():
    rgb, depth = _picture(60, 100)
    domain = Domain("real", "real", _LENS, _LENS, 1.0, 0.0, 0.001, 1, 5000)
    steps = chain(distortion=-0.1, depth_range=1.5)
    _, near, valid = adjusted_images({"rgb": rgb, "depth": depth}, domain, steps, Path())
    assert set(np.unique(near)) == {0, 3000}
    np.testing.assert_array_equal(valid, near > 0)


@pytest.mark.parametrize("length", [3, 5, 9])
def test_motion_blur_is_a_mean_along_the_rows(frames, length):
    rgb, depth = apply_chain(*frames, chain(motion_blur=length - 1))
    for image, source in zip(rgb, frames[0], strict=True):
        expected = cv2.blur(source, (length, 1), borderType=cv2.BORDER_REPLICATE)
        np.testing.assert_allclose(image, expected, atol=1)
    assert depth is frames[1]


def test_a_rolling_shutter_shears_the_rows():
    rgb = np.zeros((1, 41, 60, 3), dtype=np.uint8)
    rgb[:, :, 30] = 255
    sheared, _ = apply_chain(rgb, np.zeros((1, 4, 4), np.uint8), np.zeros((1, 4, 4), bool),
                             chain(rolling_shutter=8.0))  # fmt: skip
    assert [int(sheared[0, row, :, 0].argmax()) for row in (0, 20, 40)] == [26, 30, 34]


def test_depth_steps_round_to_levels_by_shares():
    depth = np.arange(1000, 5000, dtype=np.uint16).reshape(1, 40, 100)
    rgb = np.zeros((1, 40, 100, 3), dtype=np.uint8)
    _, rounded = apply_chain(rgb, depth, depth < 4900, chain(depth_steps=0.05))
    valid = depth < 4900
    levels = np.unique(rounded[valid]).astype(float)
    np.testing.assert_allclose(levels[1:] / levels[:-1], 1.05, atol=2e-3)
    assert np.abs(rounded[valid] / depth[valid] - 1).max() < 0.026
    np.testing.assert_array_equal(rounded[~valid], depth[~valid])
