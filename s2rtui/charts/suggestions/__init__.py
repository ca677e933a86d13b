"""The suggestions view: stored answers of `s2r suggest`, and what they gain."""
