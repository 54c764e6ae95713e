"""The command ``manoeuvre`` and the scripts from their first moment on: they may be stopped while they import."""

import atexit
import gc
import sys
from contextlib import ExitStack

from manoeuvre_nn.core.ending import listen

SAID_NOTHING = {"-q", "--quiet", "-h", "--help", "--version", "--cfg", "-c"}
"""Words of command lines whose output is read by programs, or that want none."""


def main() -> None:
    """Run ``manoeuvre COMMAND ...``."""
    listen()
    with _loading():
        from manoeuvre_nn.commands import main as commands

        commands.main()


def run(command: str) -> None:
    """Run a command with the words of the command line."""
    listen()
    with _loading():
        from manoeuvre_nn.commands import main as commands

        commands.run(command)


def _loading() -> ExitStack:
    """Say that the program is being loaded if it takes long; in lines, for ctrl-C ends it at once here."""
    from manoeuvre_nn.core.terminal import Terminal
    from manoeuvre_nn.core.waiting import loading, waiting

    atexit.register(gc.freeze)  # what is left goes with the process: to look through torch takes a second
    if not SAID_NOTHING & set(sys.argv):
        loading.enter_context(waiting(Terminal(force_terminal=False), "loading"))
    return loading
