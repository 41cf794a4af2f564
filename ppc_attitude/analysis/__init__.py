"""Metrics, figures and reports: arrays in, verdicts out."""
