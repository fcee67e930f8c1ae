"""All that a plug-in of the core is made of: a record for each kind, its registry, and helpers.

docs/howto has a page for each kind. Planners have `ambinav_planners.plugin`, rewards and
observations `ambinav_envs.plugin`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ambinav.runtime.exports import exports

if TYPE_CHECKING:
    from ambinav.buildings.readers import MAP_READERS as MAP_READERS
    from ambinav.buildings.readers import MapReader as MapReader
    from ambinav.config.files import read_text as read_text
    from ambinav.config.model import check_fields as check_fields
    from ambinav.config.numbers import as_count as as_count
    from ambinav.config.numbers import as_number as as_number
    from ambinav.config.values import Count as Count
    from ambinav.config.values import NonNegative as NonNegative
    from ambinav.config.values import Number as Number
    from ambinav.config.values import Positive as Positive
    from ambinav.config.values import Share as Share
    from ambinav.drive.localizer_spec import LOCALIZERS as LOCALIZERS
    from ambinav.drive.localizer_spec import LocalizerContext as LocalizerContext
    from ambinav.drive.localizer_spec import LocalizerSpec as LocalizerSpec
    from ambinav.drive.localizers import IntensityLocalizer as IntensityLocalizer
    from ambinav.drive.localizers import Localizer as Localizer
    from ambinav.drive.localizers import compose_motion as compose_motion
    from ambinav.export.options import MapExport as MapExport
    from ambinav.export.registry import EXPORTERS as EXPORTERS
    from ambinav.export.registry import Exporter as Exporter
    from ambinav.layers.context import LayerContext as LayerContext
    from ambinav.layers.registry import LAYERS as LAYERS
    from ambinav.layers.registry import Layer as Layer
    from ambinav.plugins import Registry as Registry
    from ambinav.routes.files import trace_route as trace_route
    from ambinav.runtime.files import replacing as replacing
    from ambinav.sensing.presets import PRESETS as PRESETS
    from ambinav.sensing.presets import ScannerPreset as ScannerPreset
    from ambinav.sensing.sensor_models import SENSOR_MODELS as SENSOR_MODELS
    from ambinav.sensing.sensor_models import SensorModel as SensorModel
else:
    __all__, __getattr__, __dir__ = exports(__name__)
