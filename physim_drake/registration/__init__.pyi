# SPDX-License-Identifier: MIT
from .distance_field import DistanceField as DistanceField
from .distance_field import build_distance_field as build_distance_field
from .registration_model import RegistrationModel as RegistrationModel
from .trimmed_icp import TrimmedIcpConfig as TrimmedIcpConfig
from .trimmed_icp import lcp_scores as lcp_scores
