"""Evaluate a network: errors of its predictions by domain and split."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from s2rstore.geometry import angles
from s2rstore.records import SPLITS
from s2rtools.models.conventions import OutputConvention
from s2rtools.models.pose_network import PoseNetwork
from s2rtools.training.training_frames import DomainFrames, TrainingFrames

_BATCH = 64

Splits = dict[str, NDArray[np.int8]]


def predict(
    network: PoseNetwork, convention: OutputConvention, domain: DomainFrames, rows: NDArray[np.intp]
) -> NDArray[np.float64]:
    """Poses (B, 3) of some rows: metres, metres, radians of the map frame."""
    device, was_training = next(network.parameters()).device, network.training
    network.eval()
    poses = [np.empty((0, 3))]
    with torch.inference_mode():
        for start in range(0, len(rows), _BATCH):
            x = torch.from_numpy(domain.inputs(rows[start : start + _BATCH])).to(device)
            raw = network(x.contiguous(memory_format=torch.channels_last))
            poses.append(convention.decode(raw.double()).cpu().numpy())
    network.train(was_training)
    return np.concatenate(poses)


def pose_errors(
    poses: NDArray[np.float64], truth: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Distance in metres and heading error in degrees, (B,) each."""
    offset = poses[:, :2] - truth[:, :2]
    turn = angles.distance(poses[:, 2], truth[:, 2])
    return np.hypot(offset[:, 0], offset[:, 1]), np.degrees(turn)


def evaluate_splits(
    network: PoseNetwork, convention: OutputConvention, frames: TrainingFrames, splits: Splits
) -> dict[str, float]:
    """Metrics by `DOMAIN.SPLIT.METRIC`.

    instances, median_error and mean_error in metres, median_heading_error in degrees, and
    baseline_error, the median error in metres of a constant prediction, the mean position.
    """
    metrics: dict[str, float] = {}
    for name, codes in splits.items():
        poses = predict(network, convention, frames.domains[name], np.arange(len(frames)))
        for code in np.unique(codes[codes >= 0]):
            rows = np.flatnonzero(codes == code)
            truth = frames.truth(name)[rows]
            distance, heading_error = pose_errors(poses[rows], truth)
            mean = np.broadcast_to(truth.mean(axis=0), truth.shape)
            values = {
                "instances": float(len(rows)),
                "median_error": float(np.median(distance)),
                "mean_error": float(distance.mean()),
                "median_heading_error": float(np.median(heading_error)),
                "baseline_error": float(np.median(pose_errors(mean, truth)[0])),
            }
            metrics |= {f"{name}.{SPLITS[code]}.{key}": value for key, value in values.items()}
    return metrics
