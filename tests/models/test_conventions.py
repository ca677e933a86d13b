"""Output conventions: decoding of raw outputs to poses in the map frame."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from s2rstore.errors import RequestError
from s2rstore.geometry import angles
from s2rtools.models.conventions import OutputConvention, parse_convention

HEADINGS = torch.linspace(-3.1, 3.1, 9, dtype=torch.float64)


def raw_output(convention: OutputConvention, heading: torch.Tensor) -> torch.Tensor:
    """The output of an ideal network of this convention at (1, 2) with these map headings."""
    frame_heading = heading if convention.frame == "map" else -math.pi / 2 - heading
    position = [torch.full_like(frame_heading, 1.0), torch.full_like(frame_heading, 2.0)]
    if convention.heading == "cos_sin":
        return torch.stack([*position, 3 * frame_heading.cos(), 3 * frame_heading.sin()], dim=1)
    unit = 180 / math.pi if convention.heading == "degrees" else 1.0
    return torch.stack([*position, frame_heading * unit + 2 * math.pi * unit], dim=1)


@pytest.mark.parametrize("heading", ["degrees", "radians", "cos_sin"])
@pytest.mark.parametrize("frame", ["map", "habitat"])
def test_every_convention_decodes_to_map_radians(heading, frame):
    convention = OutputConvention(heading, frame)
    raw = raw_output(convention, HEADINGS)
    pose = convention.decode(raw)
    assert raw.shape[1] == convention.width
    torch.testing.assert_close(pose[:, :2], raw[:, :2])
    np.testing.assert_allclose(angles.distance(pose[:, 2].numpy(), HEADINGS.numpy()), 0, atol=1e-9)
    parts = convention.components(raw)
    torch.testing.assert_close(torch.atan2(parts[:, 3], parts[:, 2]), HEADINGS)


def test_habitat_headings_equal_those_of_the_store():
    r = np.linspace(-200, 200, 7)
    raw = torch.from_numpy(np.stack([r * 0, r * 0, r], axis=1))
    decoded = OutputConvention("degrees", "habitat").decode(raw)[:, 2].numpy()
    np.testing.assert_allclose(angles.distance(decoded, angles.from_habitat(np.radians(r))), 0,
                               atol=1e-9)  # fmt: skip


def test_decoding_is_differentiable():
    raw = torch.tensor([[1.0, 2.0, 0.6, 0.8]], requires_grad=True)
    OutputConvention("cos_sin", "habitat").decode(raw)[0, 2].backward()
    assert raw.grad is not None
    assert raw.grad[0, 2:].abs().min() > 0.1


def test_conventions_are_parsed_from_text():
    convention = OutputConvention("degrees", "habitat")
    assert parse_convention(convention.to_json()) == convention
    assert parse_convention("degrees, habitat") == convention
    assert parse_convention("cos_sin") == OutputConvention("cos_sin", "map")


@pytest.mark.parametrize("text", ["turns", "degrees,moon", "{bad", '{"heading": 3}', ""])
def test_invalid_text_is_rejected_with_the_valid_forms(text):
    with pytest.raises(RequestError, match="output convention"):
        parse_convention(text)
