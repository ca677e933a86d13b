"""What the readers of recordings share: cameras, images, poses and frames."""
