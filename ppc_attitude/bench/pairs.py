"""Fair comparison: ours and the yardstick in turns, so that both see the same machine."""

import statistics
from collections.abc import Callable


def alternating(pairs: int, *measures: Callable[[], float]) -> tuple[float, ...]:
    """Call every measure in turn, `pairs` times over; return the median of each.

    Parameters
    ----------
    pairs : int
        How many rounds, at least 1.
    *measures : callable
        Each returns one figure.
    """
    rounds = [tuple(measure() for measure in measures) for _ in range(pairs)]
    return tuple(statistics.median(figures) for figures in zip(*rounds, strict=True))
