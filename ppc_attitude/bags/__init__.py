"""Recording and reading bags."""
