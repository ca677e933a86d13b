"""Array kernels behind the charts: binning, joint histograms, medians, caches keyed by identity."""
