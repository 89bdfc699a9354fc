# SPDX-License-Identifier: MIT
from .clustering import ClusteringConfig as ClusteringConfig
from .clustering import cluster_poses as cluster_poses
from .generation import HypothesisConfig as HypothesisConfig
from .generation import PoseHypotheses as PoseHypotheses
from .generation import generate_hypotheses as generate_hypotheses
from .pca import pca_poses as pca_poses
from .super4pcs import Super4PcsConfig as Super4PcsConfig
