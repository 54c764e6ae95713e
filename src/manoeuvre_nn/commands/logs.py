"""The log of a run: a plain text of what was printed, with times and warnings."""

import logging
import sys
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from manoeuvre_nn.commands import guard
from manoeuvre_nn.core.ending import full_story, stopped_by
from manoeuvre_nn.core.plain_text import harmless
from manoeuvre_nn.core.terminal import LOG

FILE = "run.log"
FORM = "%(asctime)s %(levelname)s %(message)s"
WARNINGS = logging.getLogger("py.warnings")
"""Where Python's warnings go."""


class _LogFile(logging.FileHandler):
    """Python's, which tells of a full disk with a traceback; the next file that is written tells it in a line."""

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802  # Python's name
        """Leave it to the others."""


@contextmanager
def logged(out: Path, command: str, verbose: bool = False) -> Generator[None]:
    """Keep a log in a run's folder, to which a resumed run adds.

    Args:
        out: The folder.
        command: What was typed, for the first line.
        verbose: Whether warnings and what libraries say are shown on the terminal too.

    Raises:
        KeyboardInterrupt: As it came, logged.
        SystemExit: Likewise.
    """
    root, handlers = logging.getLogger(), list[logging.Handler]([_LogFile(out / FILE, encoding="utf-8")])
    if verbose:
        handlers.append(logging.StreamHandler(sys.stderr))
        handlers[1].addFilter(lambda record: record.name != LOG.name)  # it is on the terminal already
    for handler in handlers:
        handler.setFormatter(logging.Formatter(FORM))
        root.addHandler(handler)
    before = LOG.level, root.level
    LOG.setLevel(logging.INFO)
    root.setLevel(logging.INFO if verbose else logging.WARNING)
    others = [one for one in logging.root.manager.loggerDict.values() if isinstance(one, logging.Logger)]
    for one in (LOG, WARNINGS, *(others if verbose else ())):
        one.disabled = False  # hydra disables all that it meets
    logging.captureWarnings(True)
    LOG.info("begun: %s", harmless(command))
    try:
        yield
        LOG.info("done")
    except KeyboardInterrupt as stop:
        LOG.error(stopped_by(stop))
        raise
    except SystemExit as end:  # of checks that refuse a file
        LOG.error("exit code %s", end.code)
        raise
    except Exception as error:
        LOG.error("%s", guard.explain(error) or full_story(error).strip())
        raise
    finally:
        logging.captureWarnings(False)
        LOG.setLevel(before[0])
        root.setLevel(before[1])
        for handler in handlers:
            root.removeHandler(handler)
        handlers[0].close()
