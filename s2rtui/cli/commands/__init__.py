"""One module per command of `s2r`."""
