# SPDX-License-Identifier: MIT
from .config import EstimationConfig as EstimationConfig
from .estimator import EstimationRequest as EstimationRequest
from .estimator import PoseEstimator as PoseEstimator
from .estimator import PreparedScene as PreparedScene
from .estimator import estimate_scene as estimate_scene
from .method import Method as Method
from .method_config import MethodConfig as MethodConfig
from .workers import WorkerConfig as WorkerConfig
from .workers import WorkerPool as WorkerPool
