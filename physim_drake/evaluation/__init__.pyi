# SPDX-License-Identifier: MIT
from .calibration import Calibration as Calibration
from .evaluate import evaluate_results as evaluate_results
from .report import EvaluationReport as EvaluationReport
from .report import TargetErrors as TargetErrors
from .scene_errors import ObjectError as ObjectError
from .scene_errors import TruePose as TruePose
from .scene_errors import object_errors as object_errors
from .visible_surface import vsd as vsd
