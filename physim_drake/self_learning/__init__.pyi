# SPDX-License-Identifier: MIT
from .agreement import AgreedObject as AgreedObject
from .agreement import AgreementConfig as AgreementConfig
from .agreement import EstimatedView as EstimatedView
from .agreement import agreed_objects as agreed_objects
from .exploration import ExplorationConfig as ExplorationConfig
from .exploration import Explorer as Explorer
from .exploration import explore_scenes as explore_scenes
from .labels import LabelledScene as LabelledScene
from .labels import SceneLearner as SceneLearner
from .labels import SelfLearningConfig as SelfLearningConfig
from .projection import ProjectedObjects as ProjectedObjects
from .projection import project_objects as project_objects
