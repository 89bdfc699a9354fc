# SPDX-License-Identifier: MIT
from .depenetration import depenetrate as depenetrate
from .settling import SettleConfig as SettleConfig
from .settling import Settled as Settled
from .settling import Settler as Settler
