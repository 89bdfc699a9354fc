# SPDX-License-Identifier: MIT
from .bop import BopDataset as BopDataset
from .bop import GroundTruthPose as GroundTruthPose
from .bop import Target as Target
from .bop_writer import write_bop_models as write_bop_models
from .bop_writer import write_bop_scene as write_bop_scene
from .detections import load_detections as load_detections
from .results import ResultRow as ResultRow
from .results import read_results as read_results
from .results_writer import ResultsWriter as ResultsWriter
