# SPDX-License-Identifier: MIT
from .depth import DepthRenderer as DepthRenderer
from .meshcat import draw_cloud as draw_cloud
from .meshcat import draw_estimate as draw_estimate
from .overlay import draw_overlay as draw_overlay
from .overlay import render_labels as render_labels
from .overlay import write_png as write_png
from .raster import DepthRasterizer as DepthRasterizer
from .scene import SceneImages as SceneImages
from .scene import SceneRenderer as SceneRenderer
