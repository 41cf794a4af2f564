"""What a bag can do wrong."""


class BagError(ValueError):
    """A bag cannot be written, read, recovered or exported; the message says why."""
