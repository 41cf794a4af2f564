"""Bags: recording that survives a kill, and reading into a `RunRecord`."""
