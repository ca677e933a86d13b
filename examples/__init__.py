"""Examples that use the product; run them from this repository."""
