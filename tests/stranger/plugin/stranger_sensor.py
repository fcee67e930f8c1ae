"""A scanner preset: a laser that looks all around."""

from ambinav.plugin import ScannerPreset

PRESET = ScannerPreset(
    name="stranger-lidar",
    yaml="""\
name: stranger-lidar
description: an imaginary laser with 24 beams
source: drawn for this example; name the data sheet here
parts:
  - sensor: {max_range: 3, std: 0.02, resolution: 0.01}
    planar: {beams: 24, aperture_deg: 360}
""",
)
