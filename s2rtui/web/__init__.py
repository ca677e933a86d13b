"""The application in a browser, by textual-serve; needs the extra `serve`."""
