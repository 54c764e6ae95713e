"""A proposed mapping as the yaml that is kept: every line that nobody decided says so."""

import json
import re
from typing import Any

from manoeuvre_nn.core.data_files import FORMAT
from manoeuvre_nn.core.plain_text import OBEYED
from manoeuvre_nn.recording.propose.choice import Choice
from manoeuvre_nn.recording.propose.proposal import Proposal

PLAIN = re.compile(r"[A-Za-z_][\w./-]*")
"""Words that need no quotation marks."""
NOT_PLAIN = {"y", "n", "yes", "no", "on", "off", "true", "false", "null", "none"}
UNDECIDED = "  # undecided"


def to_yaml(proposal: Proposal) -> str:
    """Write a mapping down, as a yaml that ``data.mapping=`` takes."""
    made = proposal
    name = _one_line(made.file.path.name)
    lines = [f"# Columns of {name}, proposed by manoeuvre import; look at what is undecided.", f"format: {FORMAT}"]
    lines += [f"# {_one_line(note).strip()}" for note in made.notes]
    lines += [f"# The checks say: {_one_line(made.finding).strip()}"] if made.finding else []
    lines += [f"time: {_entry(made, made.time)}", "channels:"]
    lines += [f"  {c.channel}: {_entry(made, c)}" for c in made.choices]
    for key, value in made.settings.items():
        if key not in {"time", "channels"}:
            why = made.reasons.get(key, "")
            comment = (
                f"{UNDECIDED}: {why}; {made.questions[key]}" if key in made.undecided else f"  # {why}" if why else ""
            )
            lines.append(f"{key}: {_value(value)}{_one_line(comment)}")
    return "\n".join(lines) + "\n"


def _entry(proposal: Proposal, choice: Choice) -> str:
    """One channel on a line."""
    parts = [f"{k}: {_value(v) if isinstance(v, str) else format(v, 'g')}" for k, v in choice.entry.items()]
    comment = "" if choice.decided else f"{UNDECIDED}: {choice.why}; {proposal.questions[choice.channel]}"
    called = proposal.file.called(choice.column)
    if called != choice.column:
        comment = f"  # {called}{comment.replace('  #', ',')}"
    return f"{{{', '.join(parts)}}}{_one_line(comment)}"


def _value(value: Any) -> str:
    """A value as yaml writes it."""
    if isinstance(value, str):
        if PLAIN.fullmatch(value) and value.lower() not in NOT_PLAIN:
            return value
        return json.dumps(value, ensure_ascii=_one_line(value) != value)
    return json.dumps(value)


def _one_line(text: str) -> str:
    """Text without line breaks: a heading must not break out of its comment."""
    return "".join(" " if c in "\t\n" or OBEYED.match(c) else c for c in text)
