# SPDX-License-Identifier: MIT
"""How commands stop at Ctrl-C and SIGTERM: soon, with one line, keeping what is done.

Both raise `KeyboardInterrupt` where the program is, so that files are closed, worker
processes ended and temporary folders removed on the way out. If that takes longer than
`PATIENCE`, as in the midst of a long computation, the program ends there and then:
every file is written so that this does no harm, and worker processes end with it.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from types import FrameType, TracebackType
from typing import Any, NoReturn

PATIENCE = 1.4
"""Seconds that an orderly end may take."""

KEPT: Mapping[str, str] = {
    "estimate": "the images that are done are kept; --resume goes on",
    "generate": "the scenes that are done are kept; --resume goes on",
    "train": "scenes, and the training up to its last saved step, are kept; "
    "--resume goes on",
    "pick": "with --record or --json the episodes that are done are kept; --resume "
    "goes on",
    "report": "the images that are done are kept; --resume goes on",
}
"""What is left of a command that was interrupted."""

_PAUSE = 0.02  # s
_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_SHOW_CURSOR = "\x1b[?25h"  # a bar may have hidden it

_said = threading.Event()


def say_interrupted(kept: str) -> None:
    """Tells the user, once, that the program stops and what is kept."""
    if not _said.is_set():
        _said.set()
        show = _SHOW_CURSOR if sys.stderr.isatty() else ""
        print(f"{show}interrupted: {kept}", file=sys.stderr, flush=True)


class Interrupts:
    """While it is entered, signals stop the program in this module's way.

    Args:
        command: name of the command that runs.

    Attributes:
        number: the signal that came, or None.
    """

    def __init__(self, command: str) -> None:
        self.number: int | None = None
        self._kept = KEPT.get(command, "run it again")
        self._before: dict[int, Any] = {}
        self._lost = False
        _said.clear()

    def say(self) -> None:
        """Tells what is kept, unless the command has."""
        say_interrupted(self._kept)

    def end(self) -> NoReturn:
        """Ends the program that a signal stopped, once it has cleaned up.

        Python's own way out would end libraries whose threads are still in the midst
        of a computation that the interrupt broke off, and crash now and then.
        """
        self.say()
        if self.number is None:  # raised by the program itself, in no such midst
            sys.exit(self._status)
        with suppress(OSError):
            sys.stdout.flush()  # nobody may read it any more
        os._exit(self._status)

    @property
    def _status(self) -> int:
        return 128 + (self.number or signal.SIGINT)

    def __enter__(self) -> Interrupts:
        if threading.current_thread() is not threading.main_thread():
            return self  # Python gives signals to the main thread only
        self._main = threading.get_ident()
        self._reader, self._writer = os.pipe()
        os.set_blocking(self._writer, False)
        self._wakeup = signal.set_wakeup_fd(self._writer, warn_on_full_buffer=False)
        for number in _SIGNALS:
            before = signal.getsignal(number)
            if before is not signal.SIG_IGN:  # as in the background of a shell
                self._before[number] = before
                signal.signal(number, self._stop)
        self._unraisable, sys.unraisablehook = sys.unraisablehook, self._raise_later
        threading.Thread(target=self._watch, daemon=True).start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if not self._before or self.number is not None:
            return  # the program ends now; what is left of it may be ended by force
        for number, before in self._before.items():
            signal.signal(number, before)
        signal.set_wakeup_fd(self._wakeup)
        sys.unraisablehook = self._unraisable
        os.close(self._writer)  # which ends the thread

    def _stop(self, number: int, _frame: FrameType | None) -> None:
        # Once: a second one must not break off the cleaning up after the first.
        if self.number is None:
            self.number = number
            raise KeyboardInterrupt

    def _raise_later(self, error: sys.UnraisableHookArgs) -> None:
        """Hears of errors that nothing can catch, such as those of a weak reference.

        An interrupt that is lost so is raised again where the program then is.
        """
        if self.number is not None and error.exc_type is KeyboardInterrupt:
            self._lost = True
        else:
            self._unraisable(error)

    def _watch(self) -> None:
        """Ends the program by force; the handler cannot, in a long computation."""
        number = 0
        while number not in self._before:
            received = os.read(self._reader, 1)
            if not received:
                os.close(self._reader)
                return
            number = received[0]
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            time.sleep(_PAUSE)
            if self._lost:
                self._lost, self.number = False, None
                signal.pthread_kill(self._main, number)
        self.number = number
        with suppress(Exception):
            self.say()
        os._exit(self._status)
