"""Programs and recordings that measurements and tests share."""
