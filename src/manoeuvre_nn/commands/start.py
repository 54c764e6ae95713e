"""The command ``manoeuvre`` and the scripts from their first moment on: they may be stopped while they import."""

from manoeuvre_nn.core.ending import listen


def main() -> None:
    """Run ``manoeuvre COMMAND ...``."""
    listen()
    from manoeuvre_nn.commands import main as commands

    commands.main()


def run(command: str) -> None:
    """Run a command with the words of the command line."""
    listen()
    from manoeuvre_nn.commands import main as commands

    commands.run(command)
