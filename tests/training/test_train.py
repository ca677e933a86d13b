"""Training: splits, recipes, reproducibility and resumption."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch

from s2rstore.errors import RequestError
from s2rstore.records import SPLITS
from s2rtools.models.input_contract import InputContract
from s2rtools.models.pose_network import LoadedModel
from s2rtools.training import splits, training_loop
from s2rtools.training.colour_augmentation import vary_colours
from s2rtools.training.depth_noise import DepthNoise, noise_fields, perlin
from s2rtools.training.evaluation import evaluate_splits
from s2rtools.training.recipes import RECIPES
from s2rtools.training.training_frames import CopiedFrames, TrainingFrames
from s2rtools.training.training_loop import Budget, TrainingResult, train

TRAIN, VALIDATION, TEST, UNSEEN = range(len(SPLITS))


def make_frames(n: int = 120, trajectories: int = 1) -> TrainingFrames:
    """Images whose brightness and depth encode the pose."""
    rng = np.random.default_rng(2)
    t = np.linspace(0, 1, n)
    poses = np.stack([10 * t, 5 + 3 * np.sin(6 * t), 2 * t - 1], axis=1)
    appearance = np.stack([t, 0.5 + 0.5 * np.sin(6 * t), 1 - t], axis=1)[:, None, None, :]

    def domain(kind, shade):
        rgb = 30 + 150 * appearance * shade + rng.normal(0, 3, (n, 128, 128, 3))
        depth = 20 + 200 * t[:, None, None] + rng.normal(0, 3, (n, 128, 128))
        return CopiedFrames(kind, rgb.clip(0, 255).astype(np.uint8), depth.astype(np.uint8), 0.04,
                            InputContract(size=rgb.shape[1:3]))  # fmt: skip

    domains = {"sim": domain("sim", 1.0), "sim_edit": domain("sim", 0.98)}
    codes = np.sort(np.arange(n) % trajectories).astype(np.int32)
    return TrainingFrames({**domains, "real": domain("real", 0.7)}, poses, codes)


@pytest.fixture(scope="module")
def frames() -> TrainingFrames:
    return make_frames()


@pytest.fixture(scope="module")
def trained_result(frames: TrainingFrames) -> TrainingResult:
    return train(frames, "vanilla", budget=Budget(steps=40))


@pytest.fixture(scope="module")
def few_frames() -> TrainingFrames:
    """Frames for tests in which nothing is learned."""
    return make_frames(40)


@pytest.fixture(autouse=True, scope="module")
def one_thread():
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def weights(result) -> dict[str, torch.Tensor]:
    return result.network.state_dict()


def loaded_model(result) -> LoadedModel:
    return LoadedModel("first", "resposenet", result.network, result.convention, "0" * 64)


def test_blocks_are_contiguous_and_every_fifth_is_test():
    codes = splits.split_by_blocks(np.repeat([0, 1], [542, 100]).astype(np.int32))
    for rows in (codes[:542], codes[542:]):
        block = np.arange(len(rows)) // 8
        for number in np.unique(block):
            assert len(np.unique(rows[block == number])) == 1
        assert (rows[block % 5 == 4] == TEST).all()
        assert (rows[block % 5 != 4] != TEST).all()
        share = (rows == VALIDATION).sum() / (rows != TEST).sum()
        assert 0.05 < share < 0.15
    assert set(codes) == {TRAIN, VALIDATION, TEST}
    np.testing.assert_array_equal(codes[:542], splits.split_by_blocks(np.zeros(542, np.int32)))


@pytest.mark.parametrize("count", [1, 2, 7, 8, 9, 40])
def test_short_trajectories_can_be_split(count):
    rows = np.zeros(count, np.int32)
    assert (splits.split_by_blocks(rows) >= 0).all()
    assert (splits.split_by_recording(rows) >= 0).all()


def test_what_a_start_model_has_learned_from_never_becomes_a_test():
    """One trajectory was split in halves; with a second one, all of it would be held out."""
    before = np.full(240, splits.UNSEEN, np.int8)
    before[:160] = splits.split_by_recording(np.zeros(160, np.int32))
    rows = np.repeat([0, 1], [160, 80]).astype(np.int32)
    codes = splits.split_by_recording(rows)
    assert (codes[:160] == splits.TEST).all()
    merged = splits.with_earlier(codes, before)
    assert (merged[:160] == before[:160]).all()
    assert (merged[160:] == codes[160:]).all()
    assert (splits.with_earlier(codes, None) == codes).all()


def test_a_few_steps_reduce_the_error_and_metrics_are_stored(frames, trained_result):
    result, metrics = trained_result, trained_result.metrics
    assert metrics["sim.train.median_error"] < 0.6 * metrics["sim.train.baseline_error"]
    assert metrics["real.unseen.instances"] == 120
    assert set(result.splits) == {"sim", "sim_edit", "real"}
    assert (result.splits["real"] == UNSEEN).all()
    np.testing.assert_array_equal(result.splits["sim"], splits.split_by_blocks(frames.trajectory))
    assert [row["epoch"] for row in result.history] == list(range(1, len(result.history) + 1))
    assert "validation_median_error" in result.history[-1]
    assert json.loads(result.provenance["history"]) == result.history
    assert result.provenance["steps_done"] == "40"
    assert not result.network.training


@pytest.mark.parametrize("recipe", ["dataaug", "perlin"])
def test_same_seed_and_steps_give_the_same_weights(few_frames, recipe):
    first, repeated = (train(few_frames, recipe, budget=Budget(steps=2), seed=4) for _ in range(2))
    torch.testing.assert_close(weights(first), weights(repeated), rtol=0, atol=0)
    other = train(few_frames, recipe, budget=Budget(steps=1), seed=5)
    assert not torch.equal(weights(first)["output.weight"], weights(other)["output.weight"])


def test_training_does_not_change_the_global_random_state(few_frames):
    torch.manual_seed(1)
    before = torch.random.get_rng_state()
    train(few_frames, "dataaug", budget=Budget(steps=1))
    assert torch.equal(before, torch.random.get_rng_state())


def test_a_resumed_training_equals_an_uninterrupted_one(few_frames, tmp_path):
    budget, file = Budget(steps=5), tmp_path / "a" / "checkpoint.safetensors"
    uninterrupted = train(few_frames, "dataaug", budget=budget)
    calls = []

    def interrupt(fraction: float, loss: float, seconds: float) -> None:
        calls.append(fraction)
        if len(calls) == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train(few_frames, "dataaug", budget=budget, report=interrupt, checkpoint=file)
    resumed = train(few_frames, "dataaug", budget=budget, report=interrupt, checkpoint=file)
    assert len(calls) == 5
    assert calls[-1] == 1
    torch.testing.assert_close(weights(resumed), weights(uninterrupted), rtol=0, atol=0)
    assert resumed.history == uninterrupted.history


def test_damaged_and_foreign_checkpoints_are_rejected(few_frames, tmp_path):
    file = tmp_path / "c.safetensors"
    train(few_frames, "vanilla", budget=Budget(steps=1), checkpoint=file)
    with pytest.raises(RequestError, match="another fit"):
        train(few_frames, "vanilla", budget=Budget(steps=1), seed=1, checkpoint=file)
    translation = [{"name": "translate:T", "value": 1.0, "sha256": "0" * 64}]
    with pytest.raises(RequestError, match="another fit"):
        train(
            few_frames, "vanilla", budget=Budget(steps=1), checkpoint=file, adjustments=translation
        )
    file.write_bytes(file.read_bytes()[:100])
    with pytest.raises(RequestError, match="not a checkpoint"):
        train(few_frames, "vanilla", budget=Budget(steps=1), checkpoint=file)


def test_finetune_continues_from_a_model_with_real_images(frames, trained_result):
    first = trained_result
    before = {key: value.clone() for key, value in weights(first).items()}
    tuned = train(frames, "finetune", budget=Budget(steps=10), start=loaded_model(first),
                  start_splits=first.splits)  # fmt: skip
    assert tuned.metrics["real.train.median_error"] < first.metrics["real.unseen.median_error"]
    assert (tuned.splits["real"][60:] == TEST).all()
    np.testing.assert_array_equal(tuned.splits["sim"], first.splits["sim"])
    torch.testing.assert_close(weights(first), before, rtol=0, atol=0)


def test_wrong_requests_name_what_is_missing(frames):
    only_real = TrainingFrames({"real": frames.domains["real"]}, frames.poses, frames.trajectory)
    for given, recipe, message in ((frames, "finetune", "trained model"),
                                   (frames, "magic", ", ".join(RECIPES)),
                                   (only_real, "vanilla", "no sim images")):  # fmt: skip
        with pytest.raises(RequestError, match=message):
            train(given, recipe)


def test_training_ends_after_its_minutes(few_frames):
    result = train(few_frames, "vanilla", budget=Budget(minutes=0.01))
    assert float(result.provenance["seconds"]) >= 0.6


def batch() -> torch.Tensor:
    return torch.rand(6, 4, 32, 32, generator=torch.Generator().manual_seed(0)) * 2 - 1


def test_colour_augmentation_keeps_depth_and_differs_between_images():
    x = batch()[:1].expand(6, -1, -1, -1)
    changed = vary_colours(x, torch.Generator().manual_seed(1))
    assert torch.equal(changed[:, 3], x[:, 3])
    assert changed.abs().max() <= 1
    means = changed[:, :3].mean(dim=(1, 2, 3))
    assert len(means.unique()) == 6


def test_colour_augmentation_without_range_is_the_identity(monkeypatch):
    neutral = {"BRIGHTNESS": (1, 1), "CONTRAST": (1, 1), "BLACK_POINT": (0, 0),
               "WHITE_POINT": (1, 1), "HUE": (0, 0)}  # fmt: skip
    for name, span in neutral.items():
        monkeypatch.setattr(f"s2rtools.training.colour_augmentation.{name}", span)
    x = batch()
    torch.testing.assert_close(vary_colours(x, torch.Generator()), x, rtol=0, atol=1e-5)


def test_perlin_noise_is_0_on_its_lattice_and_smooth():
    noise = perlin((64, 64), 8, np.random.default_rng(0))
    np.testing.assert_allclose(noise[::8, ::8], 0, atol=1e-6)
    assert np.abs(np.diff(noise, axis=0)).max() < 0.3
    fields = noise_fields((32, 32), np.random.default_rng(0))
    np.testing.assert_allclose(fields.std(axis=(1, 2)), 1, atol=1e-3)


def test_depth_noise_makes_holes_and_keeps_colours():
    x = batch().clamp(-0.9, 0.9)
    with_noise = DepthNoise((32, 32), 0)(x, torch.Generator().manual_seed(0))
    assert torch.equal(with_noise[:, :3], x[:, :3])
    holes = (with_noise[:, 3] == -1).float().mean(dim=(1, 2))
    assert 0 < holes.mean() < 0.3
    assert with_noise[:, 3].abs().max() <= 1


def test_the_loss_weights_a_rotation_like_a_displacement_ahead():
    truth = torch.tensor([[1.0, 2.0, 1.0, 0.0]])
    moved = torch.tensor([[1.0, 5.0, 1.0, 0.0]])
    rotated = torch.tensor([[1.0, 2.0, 0.0, 1.0]])
    assert training_loop.training_loss(moved, truth).item() == pytest.approx(0.7 * 9)
    lever = 2 * training_loop.HEADING_LEVER**2
    assert training_loop.training_loss(rotated, truth).item() == pytest.approx(0.3 * lever)


def test_the_learning_rate_rises_and_then_falls_to_zero():
    rates = [training_loop.learning_rate_share(done) for done in np.linspace(0, 1, 101)]
    assert rates[0] > 0
    assert max(rates) == pytest.approx(1)
    assert rates[-1] == pytest.approx(0)
    assert np.argmax(rates) <= 6


def test_a_domain_is_trained_and_judged_on_the_poses_of_its_own_images(few_frames, monkeypatch):
    """The sim images of loose pairs lie elsewhere than those of the instances."""
    moved = few_frames.poses + np.array([100.0, 0.0, 0.0])
    frames = replace(few_frames, own_poses={"sim": moved, "sim_edit": moved})
    targets: list[torch.Tensor] = []
    loss = training_loop.training_loss

    def keep(predicted: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
        targets.append(truth)
        return loss(predicted, truth)

    monkeypatch.setattr(training_loop, "training_loss", keep)
    result = train(frames, "vanilla", budget=Budget(steps=1))
    assert all(float(target[:, 0].min()) >= 100 for target in targets)
    splits = {"sim": np.full(40, TEST), "real": np.full(40, TEST)}
    found = evaluate_splits(result.network, result.convention, frames, splits)
    apart = evaluate_splits(result.network, result.convention, few_frames, splits)
    assert found["real.test.median_error"] == apart["real.test.median_error"]
    assert found["sim.test.median_error"] < 50 < apart["sim.test.median_error"]


def test_training_uses_a_gpu_where_there_is_one(few_frames, monkeypatch):
    """Network, inputs and truth are moved to the GPU; the result is on the processor."""
    moved: list[str] = []

    def without_gpu(to):
        def fake(self, *places, **options):
            device = next((p for p in places if isinstance(p, torch.device | str)), None)
            if device is None:
                return to(self, *places, **options)
            kind = "network" if isinstance(self, torch.nn.Module) else "tensor"
            moved.append(f"{kind} to {torch.device(device).type}")
            return to(self, "cpu", **options)

        return fake

    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    for kind in (torch.nn.Module, torch.Tensor):
        monkeypatch.setattr(kind, "to", without_gpu(kind.to))
    result = train(few_frames, "vanilla", budget=Budget(steps=1))
    assert result.provenance["device"] == "cuda"
    assert moved.index("network to cuda") < moved.index("tensor to cuda")
    assert moved.count("tensor to cuda") >= 2
    assert [place for place in moved if place.startswith("network")][-1] == "network to cpu"
