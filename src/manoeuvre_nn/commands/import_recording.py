"""``manoeuvre import``: look at a file, say how it will be read, write the mapping."""

import shlex
from pathlib import Path
from typing import NamedTuple

from rich.console import Console
from rich.table import Table as RichTable
from rich.text import Text

from manoeuvre_nn.commands.groups import CONF, accept, options, settings_in
from manoeuvre_nn.commands.guard import as_word
from manoeuvre_nn.commands.shelves import build
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.core.waiting import waiting
from manoeuvre_nn.core.writing import write_file
from manoeuvre_nn.recording.propose.choice import Choice
from manoeuvre_nn.recording.propose.proposal import Proposal, propose
from manoeuvre_nn.recording.propose.proposal_yaml import to_yaml
from manoeuvre_nn.recording.read.mapping import RECORD

USAGE = "manoeuvre import FILE [ship=kvlcc2] [name=my_ship | out=my_ship.yaml] [overwrite=true]"
HELP = f"""Propose how a measured file is read, say why, and write the mapping.

    {USAGE}

FILE is a text of columns (csv, txt, dat), a log of NMEA 0183 sentences, a bag of ROS 1 or 2 (a folder, too), an MCAP,
MAT, parquet or Excel file, or of a format that a module named by plugins= in config_dir= reads. The yaml goes to FILE's
name in this folder, to out=, or with name= to that name in this folder; with config_dir= into its recording/, where
data.mapping=NAME finds it. ship= tells units apart by the ship's speed."""
KEYS = ("ship", "name", "out", "overwrite", "config_dir", "plugins")


class _Request(NamedTuple):
    """What was asked for: a file, a ship in conf/ship or none, the yaml to write, one's own folder and modules."""

    file: Path
    ship: str
    out: Path
    own: str | None = None
    plugins: tuple[str, ...] = ()


def request(arguments: list[str]) -> _Request:
    """Read the command line; refused if an argument is not understood, or the yaml is there already."""
    given: dict[str, str] = {}
    files = []
    for argument in arguments:
        key, sign, value = argument.partition("=")
        if sign and key in KEYS:
            given[key] = value
        elif sign and key.isidentifier() and not Path(argument).exists():
            raise InputError(f"there is no setting {key}; write {USAGE}")
        else:
            files.append(Path(argument))
    if len(files) != 1:
        given_files = f" ({', '.join(map(str, files))})" if files else ""
        raise InputError(f"{len(files)} files are given{given_files}, expected one; write {USAGE}")
    if given.get("overwrite", "false") not in {"true", "false"}:
        raise InputError(f"overwrite={given['overwrite']}: expected true or false")
    if "name" in given and "out" in given:
        raise InputError("name= and out= both say where the yaml goes: write one of them")
    if "name" in given and not given["name"].replace("-", "_").isidentifier():
        raise InputError(f"name={given['name']}: expected letters, digits and _, such as name=my_ship")
    own = given.get("config_dir")
    named = Path("" if own is None else own, "" if own is None else "recording", f"{given.get('name')}.yaml")
    out = Path(given["out"]) if "out" in given else named if "name" in given else Path(f"{files[0].stem}.yaml")
    if own is not None and out == named and (CONF / "recording" / out.name).exists():
        raise InputError(f"name={given['name']} is the package's own mapping, which comes first: write another name=")
    if out.is_dir():
        raise InputError(f"out={out} is a folder: write the yaml's path")
    if out.exists() and files[0].exists() and out.samefile(files[0]):
        raise InputError(f"{out} is the file to be imported and would be lost: write another out=")
    if out.exists() and given.get("overwrite") != "true":
        raise InputError(f"{out} is there already: write overwrite=true, or another out=")
    plugins = tuple(word for word in given.get("plugins", "").strip("[]").split(",") if word)
    return _Request(files[0], given.get("ship", ""), out, own, plugins)


def ship_called(name: str, own: str | None = None) -> Particulars | None:
    """Particulars of a ship in conf/ship or in a folder of the user's own; None for no name."""
    if not name:
        return None
    ships = options("ship", own)
    if name not in ships:
        raise InputError(f"ship={name} is unknown; choose one of: {', '.join(ships)}")
    made: Ship | Particulars = build(settings_in(ships[name], "ship"), "ship")
    return made.particulars


def import_recording(asked: _Request, console: Console) -> Proposal:
    """Propose, show, write."""
    accept({"plugins": list(asked.plugins), "config_dir": asked.own})
    with waiting(console, f"reading {asked.file.name}"):
        proposal = propose(asked.file, ship_called(asked.ship, asked.own))
    write_file(asked.out, to_yaml(proposal))  # first: what is printed may have no reader
    show(proposal, console)
    _say(console, f"written: {asked.out}")
    for line in next_commands(proposal, asked):
        _say(console, line)
    return proposal


def show(proposal: Proposal, console: Console) -> None:
    """Print how a file will be read, and why."""
    table = RichTable(title=Text(proposal.file.path.name), title_justify="left", box=None, pad_edge=False)
    for heading in ("channel", "column", "unit", "sign", "misfit", "next", "why"):
        table.add_column(heading, no_wrap=heading in {"channel", "unit", "sign", "misfit"}, overflow="fold")
    for choice in (proposal.time, *proposal.choices):
        table.add_row(*(Text(cell, style="" if choice.decided else "yellow") for cell in _row(proposal, choice)))
    console.print(table)
    for key, value in proposal.settings.items():
        if key not in {"time", "channels"} and key in proposal.reasons:
            undecided = "undecided: " if key in proposal.undecided else ""
            _say(console, f"{key}: {value}  ({undecided}{proposal.reasons[key]})")
    for note in proposal.notes:
        _say(console, note)
    words = [f"{name} (no numbers: it holds {cell[:40]!r})" for name, cell in proposal.file.words.items()]
    if not_read := [*map(proposal.file.called, proposal.left_out), *words]:
        _say(console, f"Not read: {', '.join(not_read)}.")
    if proposal.finding:
        _say(console, f"The checks say: {proposal.finding}")
    if proposal.questions:
        _say(console, "Undecided; please answer, and mend the yaml:", "yellow")
    for key, question in proposal.questions.items():
        _say(console, f"  {key}: {question}", "yellow")


def _row(proposal: Proposal, choice: Choice) -> tuple[str, ...]:
    """Cells of a channel."""
    called = proposal.file.called(choice.column)
    column = called if called == choice.column else f"{choice.column} ({called})"
    offset = f", from {choice.offset:g}" if choice.offset else ""
    why = choice.why if choice.decided else f"undecided: {choice.why}"
    sign = f"{'+' if choice.sign == 1 else '-'}{offset}"
    return choice.channel, column, choice.unit, sign, choice.misfit, choice.next, why


def _say(console: Console, line: str, style: str = "") -> None:
    """A line as it is."""
    console.print(Text(line, style=style), soft_wrap=True)


def next_commands(proposal: Proposal, asked: _Request) -> list[str]:
    """What to type next, or why there is nothing to type."""
    if proposal.settings.get("kind") == RECORD:
        return ["next: nothing to train: this is a record of channels, not a manoeuvre with heading, rudder and motion"]
    own = [f"config_dir={asked.own}"] if asked.own else []
    named = asked.own is not None and asked.out.parent == Path(asked.own, "recording") and asked.out.suffix == ".yaml"
    mapping = asked.out.stem if named else str(asked.out)
    folder, name = asked.file.parent, asked.file.name
    settings = [*own, f"data.mapping={as_word(mapping)}", f"data.folder={as_word(str(folder))}"]
    settings.append(f"data.files=[{as_word(name)}]")
    words = " ".join(shlex.quote(word) for word in settings)
    ship = asked.ship or "SHIP"
    unknown = [] if asked.ship else ["write your ship for SHIP: a name that manoeuvre check --help lists, or your own"]
    check = f"next: manoeuvre check ship={ship} {words}"
    others = any(p.suffix == asked.file.suffix and p.name != name and p.is_file() for p in folder.iterdir())
    alone = [] if others else ["put a second recording into that folder before you train: one is learnt, one predicted"]
    return [*unknown, *alone, check, f"then: manoeuvre train ship={ship} data=recording {words}"]
