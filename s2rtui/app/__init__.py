"""The Textual application: screens, widgets, controllers and the renderer."""
