"""Stores in object storage and on web servers: reading, and the transfer of a generation."""
