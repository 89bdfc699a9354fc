# SPDX-License-Identifier: MIT
from __future__ import annotations

import io

from rich.console import Console

from physim_drake.cli.progress import LINE_EVERY, Steps


class Clock:
    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


def told(*, quiet: bool = False, before: int = 0, each: float = 10.0) -> list[str]:
    """The lines of ten steps, of which `before` were done, without a terminal."""
    clock, out = Clock(), io.StringIO()
    with Steps(Console(file=out, quiet=quiet), "image", 10, clock) as steps:
        steps.begin(before)
        for _ in range(10 - before):
            clock.now += each
            steps.advance()
    return out.getvalue().splitlines()


def test_a_log_gets_a_line_now_and_then() -> None:
    lines = told()
    assert len(lines) == 3 == int(10 * 10.0 / LINE_EVERY)
    assert lines[0] == "3 of 10 images, 10.0 s an image, 0:01:10 left"


def test_what_was_done_before_does_not_count_for_the_pace() -> None:
    assert told(before=4)[-1] == "10 of 10 images, 10.0 s an image, 0:00:00 left"


def test_short_work_says_nothing() -> None:
    assert told(each=0.1) == []


def test_quiet_says_nothing() -> None:
    assert told(quiet=True) == []


def test_a_terminal_gets_a_bar_with_pace_and_remaining_time() -> None:
    clock, out = Clock(), io.StringIO()
    console = Console(file=out, force_terminal=True, width=100)
    with Steps(console, "scene", 100, clock) as steps:
        clock.now = 8.0
        steps.reach(20, "settling")
    assert "settling, 0.4 s a scene, 0:00:32 left" in out.getvalue()
    assert "20/100" in out.getvalue()


def test_before_the_first_step_is_done_it_says_what_goes_on() -> None:
    clock, out = Clock(), io.StringIO()
    with Steps(Console(file=out), "episode", 2, clock) as steps:
        clock.now = LINE_EVERY
        steps.reach(0, "12.3 s, CARRY")
    assert out.getvalue() == "0 of 2 episodes, 12.3 s, CARRY\n"


def test_fast_steps_are_told_in_milliseconds() -> None:
    clock = Clock()
    steps = Steps(Console(file=io.StringIO()), "pose", 1000, clock)
    clock.now = 0.5
    steps.reach(100)
    assert steps.pace() == "5 ms a pose, 0:00:04 left"
