"""Files of a store: layout, locks, ledger, safe opening."""
