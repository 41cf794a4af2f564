"""The control laws and their registry."""
