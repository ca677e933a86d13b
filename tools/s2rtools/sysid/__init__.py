"""System identification: a simulator's parameters from recorded drives, and what they leave."""
