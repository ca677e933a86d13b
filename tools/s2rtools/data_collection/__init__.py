"""Where to take new real images: poses at which the expected reduction of real error is largest."""
