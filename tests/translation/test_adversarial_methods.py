"""CycleGAN, CUT and UNIT on a palette-swap world: unpaired images, known counterparts."""

import pytest
import torch

from s2rtools.translation import find_method
from s2rtools.translation.adversarial_training import ImagePool, luminance_loss
from s2rtools.translation.method import FitSettings
from tests.translation.palette_world import counterparts, difference, unpaired

SIZE = {"channels": "8", "blocks": "2", "batch": "2"}


@pytest.fixture(autouse=True)
def one_thread():
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


# Steps, learning rate and the share of the identity's distance to the true counterparts that is to
# be reached.
@pytest.mark.parametrize(
    ("name", "steps", "rate", "share"),
    [
        ("cut", 150, "5e-4", 0.9),
        pytest.param("cyclegan", 100, "1e-3", 0.8, marks=pytest.mark.deep),
        pytest.param("unit", 100, "1e-3", 0.95, marks=pytest.mark.deep),
    ],
)
def test_adversarial_methods_come_closer_to_the_true_counterpart(name, steps, rate, share):
    settings = FitSettings(seed=0, steps=steps, options={**SIZE, "rate": rate})
    translator = find_method(name).fit(*unpaired(), settings).translator
    first, second = counterparts()
    assert difference(translator.translate(first), second) < share * difference(first, second)


def test_the_luminance_loss_tells_bright_from_dark():
    image = torch.rand(2, 3, 8, 8, generator=torch.Generator().manual_seed(0)) * 2 - 1
    assert luminance_loss(image * 0.5 + 0.2, image) < 0.01
    assert luminance_loss(-image, image) > 1.99
    assert abs(float(luminance_loss(torch.zeros_like(image), image)) - 1) < 1e-3


def test_the_pool_returns_earlier_images_once_it_is_full():
    pool, generator = ImagePool((2, 2)), torch.Generator().manual_seed(0)
    returned = [
        float(pool.exchange(torch.full((1, 3, 2, 2), float(n)), generator)[0, 0, 0, 0])
        for n in range(150)
    ]
    assert returned[:50] == list(range(50))
    later = returned[50:]
    new = sum(value == number for number, value in enumerate(later, start=50))
    assert 25 < new < 75
    assert all(value <= number for number, value in enumerate(later, start=50))
