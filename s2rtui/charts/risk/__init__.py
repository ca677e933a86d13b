"""The risk table: what stated sigmas are worth, and radii that hold without them."""
