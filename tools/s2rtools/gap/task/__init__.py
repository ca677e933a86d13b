"""The task axis: how much larger a model's errors are on real images than on sim images."""
