"""How far heatmaps and reasons are right, where the truth is known."""
