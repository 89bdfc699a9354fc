# SPDX-License-Identifier: MIT
from .dependency import DependencyGraph as DependencyGraph
from .dependency import dependency_graph as dependency_graph
from .expansion import SceneExpander as SceneExpander
from .group_search import GroupSearch as GroupSearch
from .group_search import SearchConfig as SearchConfig
from .group_search import SearchResult as SearchResult
from .record import SearchRecord as SearchRecord
from .refinement import JointRefiner as JointRefiner
from .refinement import RefinementConfig as RefinementConfig
from .states import ExpansionConfig as ExpansionConfig
from .states import StateRenderer as StateRenderer
from .tree import heuristic_search as heuristic_search
from .tree import monte_carlo_tree_search as monte_carlo_tree_search
