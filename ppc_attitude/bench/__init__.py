"""Measurements of this stack beside a yardstick: `python -m ppc_attitude.bench`."""
