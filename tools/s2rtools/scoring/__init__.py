"""Score heatmaps and causes of the gap against the ground truth of a synthetic world."""
