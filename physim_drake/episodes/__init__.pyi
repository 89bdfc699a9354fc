# SPDX-License-Identifier: MIT
from .notes import EpisodeNotes as EpisodeNotes
from .result import EpisodeResult as EpisodeResult
from .result import LookOutcome as LookOutcome
from .result import ObjectOutcome as ObjectOutcome
from .runner import EpisodeRunner as EpisodeRunner
