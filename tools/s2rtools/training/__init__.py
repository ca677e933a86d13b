"""Training of pose networks on a store's frames.

To add a recipe, write its augmentation in one module and add one line to `recipes.RECIPES`.
"""
