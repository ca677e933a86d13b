"""Inline images in true pixels by the Kitty protocol (option `--graphics`)."""
