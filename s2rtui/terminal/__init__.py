"""The terminal: capabilities, strips, graphics protocols, Textual's private interfaces."""
