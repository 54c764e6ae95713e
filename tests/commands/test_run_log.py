"""A run keeps a plain log; -q shows errors only, -v warnings too."""

import io
import logging
import re
import time
import warnings

import pytest
from conftest import TINY

from manoeuvre_nn.commands.logs import logged
from manoeuvre_nn.core.terminal import LOG, Terminal, be_quiet
from manoeuvre_nn.core.waiting import waiting

LINE = re.compile(r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d,\d{3} (INFO|WARNING|ERROR) ")


@pytest.fixture(autouse=True)
def loud():
    yield
    be_quiet(False)


def test_a_log_holds_what_was_printed_and_warnings_with_times_and_no_progress(tmp_path, capsys):
    console = Terminal(width=40, force_terminal=True)
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        with logged(tmp_path, "manoeuvre train ship=mariner"):
            with waiting(console, "sailing zz20", seconds=0.01) as say:
                say("sailing tc25", 0.5)
                console.print("[bold] 3 runs \x1b[31m are fitted", style="red")
            piped = Terminal(file=io.StringIO())
            with waiting(piped, "sailing zz10", seconds=0.01):
                time.sleep(0.1)
            warnings.warn("a coarse clock", stacklevel=1)
    assert "sailing zz10" in piped.file.getvalue()
    text = (tmp_path / "run.log").read_text()
    assert all(LINE.match(line) for line in text.splitlines() if "warnings.warn" not in line and line.strip())
    assert "INFO begun: manoeuvre train ship=mariner" in text and "INFO done" in text
    assert r"[bold] 3 runs \x1b[31m are fitted" in text and "WARNING" in text and "a coarse clock" in text
    assert "sailing" not in text and "\x1b" not in text
    assert not logging.getLogger().handlers or all(type(h).__name__ != "_LogFile" for h in logging.getLogger().handlers)


def test_a_log_says_what_ended_the_run_and_a_resumed_one_adds_to_it(tmp_path):
    for _ in range(2):
        with pytest.raises(KeyboardInterrupt), logged(tmp_path, "manoeuvre train"):
            raise KeyboardInterrupt
    text = (tmp_path / "run.log").read_text()
    assert text.count("begun: ") == 2 and text.count("ERROR stopped by ctrl-C") == 2


def test_without_a_log_nothing_is_kept(tmp_path):
    Terminal(quiet=True).print("nothing")
    assert not LOG.isEnabledFor(logging.INFO)


def test_a_quiet_run_prints_nothing_and_logs_all(cli, fast, tmp_path):
    ended = cli(*TINY, "-q", f"out={tmp_path / 'run'}")
    assert (ended.code, ended.out, ended.err) == (0, "", "")
    assert "Held-out manoeuvres" in (tmp_path / "run/run.log").read_text()


def test_errors_are_told_in_a_quiet_run_too(cli, tmp_path):
    ended = cli(*TINY, "-q", "network.hidden=0", f"out={tmp_path / 'run'}")
    assert ended.code == 2 and ended.out == "" and ended.err.startswith("error: network.hidden=0")
    assert "ERROR network.hidden=0" in (tmp_path / "run/run.log").read_text()


def test_quiet_and_verbose_are_refused_together(cli):
    assert cli("-q", "-v").err == "error: -q and -v: write one of them\n"


@pytest.mark.parametrize("verbose", [True, False])
def test_a_verbose_run_shows_warnings_and_what_libraries_say_and_nothing_twice(tmp_path, capsys, verbose):
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        with logged(tmp_path, "manoeuvre train", verbose):
            Terminal().print("3 runs")
            warnings.warn("a coarse clock", stacklevel=1)
            logging.getLogger("a.library").info("a cache is used")
    told = capsys.readouterr()
    assert (told.out, told.err.count("3 runs")) == ("3 runs\n", 0)
    assert ("a coarse clock" in told.err, "a cache is used" in told.err) == (verbose, verbose)
