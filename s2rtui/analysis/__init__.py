"""Array kernels behind the charts: counts, sums and medians per bin, histograms, caches."""
