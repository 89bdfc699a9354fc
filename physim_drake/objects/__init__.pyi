# SPDX-License-Identifier: MIT
from .container_name import ContainerName as ContainerName
from .containers import Container as Container
from .containers import load_container as load_container
from .model import ObjectLibrary as ObjectLibrary
from .model import ObjectModel as ObjectModel
from .sdformat import write_drake_model as write_drake_model
from .symmetry import describe_symmetry as describe_symmetry
from .symmetry import detect_symmetry as detect_symmetry
from .symmetry import near_symmetries as near_symmetries
