"""System identification: estimate a simulator's parameters from recorded drives."""
