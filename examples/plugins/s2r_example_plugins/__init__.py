"""Parts for s2rtui: one module for each kind."""
