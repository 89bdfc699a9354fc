# SPDX-License-Identifier: MIT
"""The command line: one module a command, and no logic of its own.

Modules here import what they need inside their functions, so that `--help` and shell
completion answer at once.
"""

from __future__ import annotations

import logging
import os
import sys
from contextlib import suppress
from typing import Annotated, NoReturn

import typer

from physim_drake import __version__
from physim_drake.cli.detect import detect
from physim_drake.cli.doctor import doctor
from physim_drake.cli.estimate import EstimateCommand, estimate
from physim_drake.cli.estimate_image import estimate_image
from physim_drake.cli.evaluate import evaluate
from physim_drake.cli.explain import explain
from physim_drake.cli.generate import generate
from physim_drake.cli.interrupts import Interrupts
from physim_drake.cli.learn import learn
from physim_drake.cli.models import models_app
from physim_drake.cli.pick import pick
from physim_drake.cli.report import report
from physim_drake.cli.train import train
from physim_drake.errors import PhysimError

_INTERRUPTED = 130

app = typer.Typer(
    name="physim-drake",
    help="6D poses of all known objects in a cluttered scene, from one RGB-D image.\n\n"
    "Example: `physim-drake estimate datasets/lab --out results.csv`; the help of each "
    "command has another.",
    no_args_is_help=True,
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command(cls=EstimateCommand)(estimate)
app.command()(estimate_image)
app.command()(evaluate)
app.command()(report)
app.command()(explain)
app.command()(generate)
app.command()(train)
app.command()(detect)
app.command()(learn)
app.command()(pick)
app.command()(doctor)
app.add_typer(models_app, name="models")


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"physim-drake {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option(
            "--version",
            help="Print the version and exit.",
            callback=_print_version,
            is_eager=True,
        ),
    ] = False,
) -> None:
    """Declares the options that stand before a command."""


def main() -> None:
    """Runs the program.

    An error that a user can cause is one line, with exit status 2, and so is a file
    that unexpectedly fails. Ctrl-C and SIGTERM also stop it with one line, and with
    exit status 130 or 143.
    """
    with Interrupts(next(iter(sys.argv[1:]), "")) as interrupts:
        try:
            app()
        except PhysimError as error:
            if interrupts.number is None:
                _end(str(error))
        except OSError as error:
            if interrupts.number is None:
                logging.getLogger(__name__).debug("what failed:", exc_info=True)
                _end(_told(error))
        except KeyboardInterrupt:
            pass
        except SystemExit as end:
            # Typer makes this of an interrupt.
            if interrupts.number is None and end.code != _INTERRUPTED:
                raise
        except Exception:
            # An interrupt in an import, for instance, may come out as another error.
            if interrupts.number is None:
                raise
        interrupts.end()


def _end(message: str) -> NoReturn:
    """Ends the program with one line about what is wrong."""
    with suppress(OSError):  # stderr may lie on the disk that is full
        print(f"error: {' '.join(message.split())}", file=sys.stderr, flush=True)
    sys.exit(2)


def _told(error: OSError) -> str:
    """What is said of a file, or of the output, that fails."""
    where = error.filename or "a file or the output"
    try:
        sys.stdout.flush()
    except OSError:
        where = "the output"
        # What is left of it would fail again at the end of the program.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return (
        f"{where}: cannot be read or written: {error.strerror or error}; see that it "
        "is there, may be used, and that its disk has space left"
    )
