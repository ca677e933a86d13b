"""Importers, one module per data set layout; `s2rtools.datasets.IMPORTERS` lists them."""
