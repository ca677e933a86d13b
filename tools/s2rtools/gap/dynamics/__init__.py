"""The dynamics axis: errors of simulated drives against real drives with the same commands."""
