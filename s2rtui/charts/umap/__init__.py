"""The umap view."""
