# SPDX-License-Identifier: MIT
from .calibration import Calibration as Calibration
from .evaluate import evaluate_results as evaluate_results
from .matching import ObjectError as ObjectError
from .matching import ObjectPose as ObjectPose
from .matching import object_errors as object_errors
from .report import EvaluationReport as EvaluationReport
from .report import InstanceErrors as InstanceErrors
from .visible_surface import vsd as vsd
