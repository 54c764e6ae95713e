"""The one exception that a user of the command line is meant to see."""


class InputError(ValueError):
    """Something that a person gave cannot be used.

    The message is one line: what was given, what was expected, and what to write instead. Entry points print it without
    a traceback and end with exit code 2, before any computing starts.
    """


def check_choice(what: str, given: object, choices: list[str] | tuple[str, ...]) -> None:
    """Refuse a name that is not among the known ones.

    Args:
        what: What the name stands for, for the message.
        given: The name that was given.
        choices: The names that exist.

    Raises:
        InputError: If ``given`` is not one of ``choices``; the message lists them.
    """
    if given not in choices:
        raise InputError(f"{what} {given!r} is unknown; choose one of: {', '.join(map(str, choices))}")
