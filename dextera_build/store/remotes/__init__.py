"""Other stores that this one reads from and writes to."""
