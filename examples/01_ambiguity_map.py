"""A building drawn in code, its ambiguity map, and the map as a picture."""

import math
from pathlib import Path

import matplotlib.pyplot as plt
import shapely

import ambinav as an

hall, corridor = shapely.box(0, 0, 14, 12), shapely.box(14, 5, 34, 7)  # metres: free floor
environment = an.environment_from_shapes([hall, corridor], obstacles=[shapely.box(2, 9, 4, 10)])
sensor = an.RangeSensor(max_range=4.0, std=0.03, resolution=0.001)
scanner = an.RangeScanner.planar(sensor=sensor, beams=60, aperture=math.tau)
amap = an.build_map(environment, scanner, spacing=0.2)
print("in the hall", amap.sample("level", 7.0, 6.0), "in the corridor", amap.sample("level", 24, 6))
Path("out").mkdir(exist_ok=True)
amap.dataset["level"].plot(cmap="coolwarm", vmin=0, vmax=1)  # an xarray.Dataset, as any other
plt.gca().set_aspect("equal")
plt.savefig("out/01-level.png")
amap.save("out/01-map.zarr")
