"""How much worse the task is done on real images than on sim images."""
