# SPDX-License-Identifier: MIT
from .detection_alternatives import rival_choices as rival_choices
from .detection_selection import ChoiceConfig as ChoiceConfig
from .detection_selection import assign_detections as assign_detections
from .detection_selection import choose_detections as choose_detections
from .observation import Detection as Detection
from .observation import RgbdObservation as RgbdObservation
from .observation import Segment as Segment
from .segmentation import estimate_normals as estimate_normals
from .segmentation import foreground as foreground
from .segmentation import segment_objects as segment_objects
from .segmented_scene import SegmentedScene as SegmentedScene
from .segmented_scene import prepare_scene as prepare_scene
from .support_surface import SupportSurface as SupportSurface
from .support_surface import find_support_surface as find_support_surface
from .support_surface import heights_above as heights_above
from .support_surface import surface_at_height as surface_at_height
