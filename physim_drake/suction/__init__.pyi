# SPDX-License-Identifier: MIT
from .cup import Seal as Seal
from .cup import SuctionConfig as SuctionConfig
from .cup import Surface as Surface
from .cup import find_seal as find_seal
from .cup import step_vacuum as step_vacuum
