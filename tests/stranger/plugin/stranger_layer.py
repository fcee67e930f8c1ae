"""A layer: the share of the scanner's range that its beams see, on average."""

import numpy as np

from ambinav.plugin import Layer


def seen_range(context):
    """Mean of range / maximum range of the free cells, shape (ny, nx) or (ny, nx, K)."""
    most = context.scanner.max_range
    shares = [
        np.minimum(context.hits(k).distance, most).mean(axis=1) / most
        for k in range(len(context.headings))
    ]
    return {"seen_range": context.spread(np.stack(shares, axis=1))}


LAYER = Layer(
    name="seen_range",
    title="mean share of the range that is seen",
    unit="1",
    source="own: an example",
    worse="high",
    compute=seen_range,
)
