"""Counterfactual images: the real view as it would look with the content of the simulated scene."""
