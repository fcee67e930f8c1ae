"""Perceptual ambiguity maps: where a building leaves a range scanner lost.

The names below are loaded when they are first used, so that `import ambinav` stays quick and
pulls in no optional package.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ambinav.maps import updater
from ambinav.runtime.exports import exports
from ambinav.runtime.progress import Progress

if TYPE_CHECKING:
    from ambinav.buildings.load import load_environment as load_environment
    from ambinav.buildings.mesh.cloud import read_cloud as read_cloud
    from ambinav.buildings.mesh.floor import floor_environment as floor_environment
    from ambinav.buildings.mesh.octomap import read_octomap as read_octomap
    from ambinav.buildings.mesh.read import read_mesh as read_mesh
    from ambinav.buildings.shapes import environment_from_shapes as environment_from_shapes
    from ambinav.casting.mesh.mesh import Mesh as Mesh
    from ambinav.casting.prisms.prisms import Prisms as Prisms
    from ambinav.casting.prisms.prisms import Solid as Solid
    from ambinav.casting.space import SpaceRays as SpaceRays
    from ambinav.demo import DEMO_BUILDING as DEMO_BUILDING
    from ambinav.demo import DEMO_GOAL as DEMO_GOAL
    from ambinav.demo import DEMO_SCANNER as DEMO_SCANNER
    from ambinav.demo import DEMO_SCENARIO as DEMO_SCENARIO
    from ambinav.demo import DEMO_START as DEMO_START
    from ambinav.drive.drive import Controller as Controller
    from ambinav.drive.drive import drive_route as drive_route
    from ambinav.drive.drives import Drives as Drives
    from ambinav.drive.metrics import Metrics as Metrics
    from ambinav.drive.metrics import metrics as metrics
    from ambinav.drive.noise import OdometryNoise as OdometryNoise
    from ambinav.drive.people import People as People
    from ambinav.drive.robot import Robot as Robot
    from ambinav.export.formats.exporting import export_map as export_map
    from ambinav.export.options import ExportOptions as ExportOptions
    from ambinav.forecasting.braking import BrakingRule as BrakingRule
    from ambinav.forecasting.ensemble import Ensemble as Ensemble
    from ambinav.forecasting.ensemble import EnsembleRunner as EnsembleRunner
    from ambinav.forecasting.ensemble import LostRule as LostRule
    from ambinav.forecasting.ensemble import ensemble as ensemble
    from ambinav.forecasting.forecast import Forecast as Forecast
    from ambinav.forecasting.forecast import Forecaster as Forecaster
    from ambinav.forecasting.forecast import forecast as forecast
    from ambinav.forecasting.localizer_class import LocalizerClass as LocalizerClass
    from ambinav.forecasting.slowness import with_slowness as with_slowness
    from ambinav.geometry.collision.checker import CollisionChecker as CollisionChecker
    from ambinav.geometry.collision.reach import find_reach as find_reach
    from ambinav.geometry.environment import Environment as Environment
    from ambinav.geometry.extrude import extruded as extruded
    from ambinav.geometry.footprint import Footprint as Footprint
    from ambinav.geometry.motion.steering import Steering as Steering
    from ambinav.geometry.obstacle import Obstacle as Obstacle
    from ambinav.layers.build import with_layers as with_layers
    from ambinav.layers.reflectors.views import ReflectorRules as ReflectorRules
    from ambinav.localization.expected_covariance import expected_covariance as expected_covariance
    from ambinav.localization.information_gain import information_gain as information_gain
    from ambinav.localization.odometry import OdometryModel as OdometryModel
    from ambinav.localization.online import online_localizability as online_localizability
    from ambinav.localization.parameters import MclParameters as MclParameters
    from ambinav.logs.carmen import read_carmen as read_carmen
    from ambinav.map_building.build import build_map as build_map
    from ambinav.map_building.volume import build_volume as build_volume
    from ambinav.maps.ambiguity_map import AmbiguityMap as AmbiguityMap
    from ambinav.maps.ambiguity_volume import AmbiguityVolume as AmbiguityVolume
    from ambinav.routes.clock import SpeedLimits as SpeedLimits
    from ambinav.routes.clock import SpeedProfile as SpeedProfile
    from ambinav.routes.clock import speed_profile as speed_profile
    from ambinav.routes.evaluate import evaluate_route as evaluate_route
    from ambinav.routes.evaluate import join_routes as join_routes
    from ambinav.routes.files import load_route as load_route
    from ambinav.routes.files import save_route as save_route
    from ambinav.routes.pareto import ParetoFront as ParetoFront
    from ambinav.routes.route import Route as Route
    from ambinav.routes.trips import Trip as Trip
    from ambinav.routes.trips import read_trips as read_trips
    from ambinav.runtime.errors import InputError as InputError
    from ambinav.runtime.errors import InputWarning as InputWarning
    from ambinav.sensing.curves import Polynomial as Polynomial
    from ambinav.sensing.curves import Table as Table
    from ambinav.sensing.intensity import Intensity as Intensity
    from ambinav.sensing.intensity_readings import read_intensity as read_intensity
    from ambinav.sensing.presets import preset_names as preset_names
    from ambinav.sensing.scanner import RangeScanner as RangeScanner
    from ambinav.sensing.sensor import RangeSensor as RangeSensor
    from ambinav.server.client import Client as Client
    from ambinav.server.client import ServerError as ServerError
    from ambinav.service.service import AmbiguityService as AmbiguityService
    from ambinav.service.volume_service import VolumeService as VolumeService
    from ambinav.store.map_store import MapStore as MapStore
    from ambinav.studies.audit.advise import advise as advise
    from ambinav.studies.audit.aliasing import find_aliasing as find_aliasing
    from ambinav.studies.audit.audit import Audit as Audit
    from ambinav.studies.audit.audit import audit as audit
    from ambinav.studies.audit.lost_routes import find_lost_routes as find_lost_routes
    from ambinav.studies.audit.report import write_audit as write_audit
    from ambinav.studies.compare.criterion import judge_route as judge_route
    from ambinav.studies.compare.report import compare_routes as compare_routes
    from ambinav.studies.compare.scenario_file import load_scenario as load_scenario
    from ambinav.studies.design.place.candidates import PlaceRules as PlaceRules
    from ambinav.studies.design.place.study import place_obstacles as place_obstacles
    from ambinav.studies.design.reflectors.study import plan_reflectors as plan_reflectors
    from ambinav.studies.design.region import Region as Region
    from ambinav.studies.design.scanners.compare import compare_scanners as compare_scanners
    from ambinav.studies.design.sweep.sweep import sweep_scanner as sweep_scanner
    from ambinav.tiles.build import build_tiled as build_tiled
    from ambinav.version import __version__ as __version__
else:
    __all__, __getattr__, __dir__ = exports(__name__)


def _update(
    amap: AmbiguityMap, env: Environment, *, progress: bool | Progress = False
) -> AmbiguityMap:
    # Imported late: it loads the kernels.
    from ambinav.map_building.update import updated

    return updated(amap, env, progress=progress)


updater.install(_update)
