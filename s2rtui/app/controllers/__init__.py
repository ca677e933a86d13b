"""Controllers: each turns one kind of key, mouse or message into changes of the session."""
