"""Import predicted poses that another program made, as a run without a network."""
