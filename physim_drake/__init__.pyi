# SPDX-License-Identifier: MIT
from . import evaluation as evaluation
from . import models as models
from . import picking as picking
from . import scenes as scenes
from . import systems as systems
from . import testing as testing
from .camera import CameraIntrinsics as CameraIntrinsics
from .datasets.bop import BopDataset as BopDataset
from .datasets.detections import load_detections as load_detections
from .episodes.runner import EpisodeRunner as EpisodeRunner
from .errors import InputError as InputError
from .errors import PhysimError as PhysimError
from .estimation.config import EstimationConfig as EstimationConfig
from .estimation.estimator import PoseEstimator as PoseEstimator
from .estimation.estimator import estimate_scene as estimate_scene
from .estimation.method import Method as Method
from .objects.model import ObjectLibrary as ObjectLibrary
from .objects.model import ObjectModel as ObjectModel
from .observation.observation import Detection as Detection
from .observation.observation import RgbdObservation as RgbdObservation
from .picking.scenario import PickScenario as PickScenario
from .picking.scenario import load_scenario as load_scenario
from .scene_estimate import ObjectEstimate as ObjectEstimate
from .scene_estimate import SceneEstimate as SceneEstimate
from .systems.perception import AddPerceptionDiagram as AddPerceptionDiagram
from .systems.perception_config import PerceptionConfig as PerceptionConfig
from .systems.pick_cell import PickCell as PickCell

__version__: str
