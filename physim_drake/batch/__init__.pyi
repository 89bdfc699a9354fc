# SPDX-License-Identifier: MIT
from .images import ImageResult as ImageResult
from .images import boxes_only as boxes_only
from .images import choose_images as choose_images
from .images import detection_lookup as detection_lookup
from .images import estimate_images as estimate_images
from .images import match_detections as match_detections
from .images import trained_lookup as trained_lookup
from .ray import RayEstimator as RayEstimator
from .ray import make_estimator as make_estimator
