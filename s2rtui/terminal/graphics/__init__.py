"""Pictures in true pixels, on request: what the terminal draws, and what is sent to it."""
