"""Modal screens: help, tour, doctor, jump, saved selections."""
