# SPDX-License-Identifier: MIT
from .config import RestLimits as RestLimits
from .config import SceneConfig as SceneConfig
from .config import SettlingConfig as SettlingConfig
from .dataset import generate_dataset as generate_dataset
from .generation import GeneratedScene as GeneratedScene
from .generation import generate_scene as generate_scene
from .recording import DatasetConfig as DatasetConfig
from .recording import record_scene as record_scene
from .recording import write_scene as write_scene
from .views import SceneView as SceneView
from .views import ViewConfig as ViewConfig
