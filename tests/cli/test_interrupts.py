# SPDX-License-Identifier: MIT
"""The program's own `main`, with a command that waits in one way or another."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from physim_drake.cli.interrupts import KEPT

PROMISED = 2.0  # s; the ways take 60
TRIES = 5  # on a computer with much else to do it may take longer now and then

PROGRAM = """
import ctypes, signal, sys, threading, time, weakref
signal.signal(signal.SIGINT, signal.default_int_handler)
import physim_drake.cli as cli
from physim_drake.cli.interrupts import say_interrupted

def waits():
    time.sleep(60)

def computes_without_the_lock():
    ctypes.CDLL(None).usleep(60_000_000)
    for _ in range(60):
        ctypes.CDLL(None).usleep(1_000_000)

def says_itself():
    try:
        time.sleep(60)
    except KeyboardInterrupt:
        say_interrupted("3 images are kept")
        raise

def swallows():
    for _ in range(60):
        try:
            time.sleep(1)
        except KeyboardInterrupt:
            pass

def cleans_up_slowly():
    try:
        time.sleep(60)
    finally:
        time.sleep(60)

def fails_at_an_import():
    try:
        time.sleep(60)
    except KeyboardInterrupt:
        raise ImportError("in the midst of numpy")

def is_where_errors_are_ignored():
    class Thing:
        pass

    thing = Thing()
    reference = weakref.ref(thing, lambda _: time.sleep(0.5))
    del thing
    try:
        time.sleep(60)
    finally:
        print("cleaned up", flush=True)

def begins(way=globals()[sys.argv.pop()]):
    print("ready", flush=True)
    way()

cli.app.registered_commands = [
    c for c in cli.app.registered_commands if c.callback is not cli.generate
]
cli.app.command("generate")(lambda: begins())
cli.main()
"""


def start(way: str) -> subprocess.Popen[str]:
    process = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, "generate", way],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    time.sleep(0.1)
    return process


def stop(process: subprocess.Popen[str], send: Callable[[], None]) -> tuple[str, float]:
    """What the process says on stderr, and how long it takes to end, s."""
    begun = time.monotonic()
    send()
    errors = process.communicate(timeout=30)[1]
    return errors, time.monotonic() - begun


def stops_as_promised(way: str, number: int) -> bool:
    """Whether a signal ends it soon. It must say what is kept in any case."""
    for _ in range(TRIES):
        process = start(way)
        errors, seconds = stop(process, partial(process.send_signal, number))
        assert process.returncode == 128 + number
        assert errors == f"interrupted: {KEPT['generate']}\n"
        if seconds < PROMISED:
            return True
    return False


@pytest.mark.parametrize(
    "way", ["waits", "swallows", "cleans_up_slowly", "fails_at_an_import"]
)
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_a_command_with_one_line(way: str, number: int) -> None:
    assert stops_as_promised(way, number)


def test_a_long_computation_is_ended_by_force() -> None:
    assert stops_as_promised("computes_without_the_lock", signal.SIGTERM)


def test_the_terminal_s_ctrl_c_and_a_second_one() -> None:
    process = start("waits")

    def press_twice() -> None:
        os.killpg(process.pid, signal.SIGINT)
        os.killpg(process.pid, signal.SIGINT)

    errors, _ = stop(process, press_twice)
    assert process.returncode == 130
    assert errors == f"interrupted: {KEPT['generate']}\n"


def test_what_a_command_says_itself_is_said_once() -> None:
    process = start("says_itself")
    errors, _ = stop(process, lambda: process.send_signal(signal.SIGINT))
    assert process.returncode == 130
    assert errors == "interrupted: 3 images are kept\n"


def test_an_interrupt_that_is_lost_in_a_callback_comes_again() -> None:
    process = start("is_where_errors_are_ignored")
    process.send_signal(signal.SIGINT)
    out, errors = process.communicate(timeout=30)
    assert process.returncode == 130
    assert errors == f"interrupted: {KEPT['generate']}\n"
    assert out == "cleaned up\n"


def test_every_long_command_says_what_is_kept() -> None:
    folder = Path(__file__).parents[2] / "physim_drake" / "cli"
    assert all((folder / f"{name}.py").exists() for name in KEPT)
