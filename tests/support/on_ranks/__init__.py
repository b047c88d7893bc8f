"""Programs that print figures on any number of ranks."""
