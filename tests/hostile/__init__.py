"""What a hostile or damaged store, file, name or terminal may not do."""
