# SPDX-License-Identifier: MIT
"""`physim-drake doctor`: whether this installation works, and what to do if not."""

from __future__ import annotations

import json
import sys
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

if TYPE_CHECKING:
    from physim_drake.doctor.checks import Check

_COLORS = {"ok": "green", "warning": "yellow", "FAIL": "red"}
_INDENT = 9


def doctor(
    as_json: Annotated[
        bool, typer.Option("--json", help="Print JSON instead, for programs.")
    ] = False,
) -> None:
    """Check the installation: rendering, physics, processes, models and the rest.

    Each check prints one line: ok, warning (works, but not as well as it might) or
    FAIL, and below it what to do. The checks are real: a scene is rendered, a box is
    dropped, processes are started. They take ten to twenty seconds.

    Exit status: 0 if nothing fails, else 1.

    Example: `physim-drake doctor --json`
    """
    from physim_drake.cli.progress import Steps
    from physim_drake.doctor.checks import CHECKS, Status, check_installation

    # If this is not a terminal, the lines themselves tell how far it is.
    quiet = as_json or not sys.stdout.isatty()
    checks = []
    with Steps(Console(stderr=True, quiet=quiet), "check", CHECKS) as steps:
        for check in check_installation():
            checks.append(check)
            if not as_json:
                _tell(check)
            steps.advance()
    failed = [check for check in checks if check.status is Status.FAIL]
    if as_json:
        report = {"ok": not failed, "checks": [check.as_dict() for check in checks]}
        typer.echo(json.dumps(report, indent=1))
    elif failed:
        typer.echo(f"{len(failed)} of {len(checks)} checks failed")
    else:
        typer.echo("everything needed works")
    if failed:
        raise typer.Exit(1)


def _tell(check: Check) -> None:
    status = str(check.status)
    colored = typer.style(f"{status:{_INDENT}}", fg=_COLORS[status])
    typer.echo(f"{colored}{check.name}: {check.message}")
    if check.remedy:
        typer.echo(f"{'':{_INDENT}}-> {check.remedy}")
