"""How different sim and real images look to a network."""
