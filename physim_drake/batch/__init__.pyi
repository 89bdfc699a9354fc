# SPDX-License-Identifier: MIT
from .detection_source import DetectionLookup as DetectionLookup
from .detection_source import DetectionSource as DetectionSource
from .detection_source import match_detections as match_detections
from .image_names import choose_images as choose_images
from .images import ImageResult as ImageResult
from .images import estimate_images as estimate_images
from .ray import RayEstimator as RayEstimator
from .ray import make_estimator as make_estimator
