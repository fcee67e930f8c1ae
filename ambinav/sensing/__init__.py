"""Range sensors, the scanners made of them, their calibration and the presets."""

from __future__ import annotations

from ambinav.sensing.calibration import CalibrationFit
from ambinav.sensing.curves import Polynomial, Table
from ambinav.sensing.intensity import Intensity
from ambinav.sensing.intensity_readings import read_intensity
from ambinav.sensing.preset_summary import PresetSummary, preset_summaries
from ambinav.sensing.presets import PRESETS, ScannerPreset, preset_names
from ambinav.sensing.rays import RayTable
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.sensor import RangeSensor

__all__ = [
    "PRESETS",
    "CalibrationFit",
    "Intensity",
    "Polynomial",
    "PresetSummary",
    "RangeScanner",
    "RangeSensor",
    "RayTable",
    "ScannerPreset",
    "Table",
    "preset_names",
    "preset_summaries",
    "read_intensity",
]
