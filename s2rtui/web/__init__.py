"""The application in a browser, with textual-serve; needs the extra `serve`."""
