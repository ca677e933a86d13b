"""Images in true pixels: kitty's protocol, iTerm2's protocol and sixels (option `--graphics`)."""
