"""Computed tasks of a run: map grids, outliers, UMAP projection."""
