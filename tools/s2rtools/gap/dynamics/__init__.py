"""How far a simulated drive is from the real one of the same commands, and how much later."""
