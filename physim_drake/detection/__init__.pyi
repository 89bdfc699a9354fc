# SPDX-License-Identifier: MIT
from .average_precision import AveragePrecision as AveragePrecision
from .detect_images import write_detections as write_detections
from .detector import NetworkDetector as NetworkDetector
