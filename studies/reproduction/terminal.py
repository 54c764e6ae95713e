"""A paper done again, for the terminal: every claim beside ours, long lists folded to what does not hold."""

from collections.abc import Iterable, Sequence
from math import isfinite

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.padding import Padding
from rich.rule import Rule
from rich.table import Table
from rich.text import Text

from manoeuvre_nn.report.tables import Row, rich_table, text
from studies.reproduction.document import Done, Reproduction, verdict_counts
from studies.reproduction.section import ChapterResult, Claim, Verdict

STYLES: dict[Verdict, str] = {
    "holds": "green",
    "holds in direction": "yellow",
    "does not hold": "bold red",
    "not comparable": "dim",
}
HOLDS = "holds"
SHORT: dict[Verdict, tuple[str, str]] = {
    "holds": ("holds", "hold"),
    "holds in direction": ("in direction", "in direction"),
    "does not hold": ("does not hold", "do not hold"),
    "not comparable": ("not comparable", "not comparable"),
}
"""What a count of them is called: of one, of several."""
LONG, MOST, ROWS = 8, 12, 8
"""Claims of one table or figure beyond which those that hold are left out, claims and rows that are shown at most."""
STATEMENT = 12
"""Letters beyond which a value has no room in a column."""
MOST_COLUMNS = 9
"""Columns that a table of the terminal has room for."""


def number(value: float | str) -> str:
    """A value of a claim as people read it.

    Args:
        value: Number or statement.

    Returns:
        Four significant digits.
    """
    return value if isinstance(value, str) else text(float(value), 4)


def difference(claim: Claim) -> str:
    """How far ours is from the paper's.

    Args:
        claim: The claim.

    Returns:
        Two significant digits with their sign; empty where there are no numbers.
    """
    gap = claim.difference
    if gap is None or not isfinite(gap):
        return ""
    largest = max(abs(float(value)) for value in (claim.paper, claim.ours))
    return "0" if abs(gap) < 1e-9 * largest else f"{gap:+.2g}"


def about(claim: Claim) -> str:
    """What a claim is about.

    Args:
        claim: The claim.

    Returns:
        With the unit: ``advance [L]``.
    """
    return f"{claim.what} [{claim.unit}]" if claim.unit else claim.what


def by_place(claims: Iterable[Claim]) -> dict[str, list[Claim]]:
    """Claims by table, figure or section of the paper.

    Args:
        claims: The claims.

    Returns:
        Place -> its claims, in the order in which they were given.
    """
    places: dict[str, list[Claim]] = {}
    for claim in claims:
        places.setdefault(claim.where, []).append(claim)
    return places


def tally(claims: Iterable[Claim]) -> str:
    """Verdicts counted, in words.

    Args:
        claims: The claims.

    Returns:
        Such as ``12 hold, 2 do not hold``; verdicts that were not given are left out.
    """
    words = [f"{count} {SHORT[verdict][count > 1]}" for verdict, count in verdict_counts(claims).items() if count]
    return ", ".join(words) or "no claims"


def clock(seconds: float) -> str:
    """A time that passed.

    Args:
        seconds: In seconds.

    Returns:
        Minutes and seconds: ``3:05``.
    """
    return f"{int(seconds) // 60}:{int(seconds) % 60:02d}"


def print_chapter(done: Done, console: Console) -> None:
    """Print a chapter.

    Args:
        done: The chapter.
        console: Where.
    """
    section = done.section
    if section is None:
        console.print(Text(f"Chapter {done.name} failed: {done.failure}", "bold red"), soft_wrap=True)
        return
    console.print()
    console.print(Rule(Text(section.title, "bold"), align="left", style="dim"))
    console.print(Text(section.summary))
    for place, claims in by_place(section.claims).items():
        _print_place(place, claims, console)
    for heading, rows in section.tables.items():
        _print_table(heading, rows, console)
    if section.plots:
        console.print()
        console.print(Text(f"Figures: {', '.join(plot.name for plot in section.plots)}", "dim"))


def _print_place(place: str, claims: Sequence[Claim], console: Console) -> None:
    """Claims of one table or figure of the paper."""
    left = claims if len(claims) <= LONG else [claim for claim in claims if claim.verdict != HOLDS]
    shown = left[:MOST]
    table = _claim_table(place, tally(claims), console.width)
    why = ""
    for claim in (claim for claim in shown if not _is_statement(claim)):
        verdict = _verdict(claim, "as above" if claim.why == why else claim.why)
        # As text they are not markup: brackets are shown and not obeyed.
        cells = (Text(cell) for cell in (about(claim), number(claim.paper), number(claim.ours), difference(claim)))
        table.add_row(*cells, verdict)
        why = claim.why
    console.print()
    if table.row_count or not shown:
        console.print(table)
    else:
        console.print(Text.assemble((place, "bold"), (f"   {tally(claims)}", "dim")))
    for claim in filter(_is_statement, shown):
        _print_statement(claim, console)
    rest = tally(claim for claim in claims if claim not in shown)
    if len(shown) < len(claims):
        console.print(Text(f"  and {len(claims) - len(shown)} more: {rest}", "dim"))


def _is_statement(claim: Claim) -> bool:
    """Whether its values are too long for columns."""
    return max(len(number(claim.paper)), len(number(claim.ours))) > STATEMENT


def _verdict(claim: Claim, why: str) -> Text:
    """Verdict and reason; only the verdict is coloured."""
    told = Text().append(claim.verdict, STYLES[claim.verdict])
    return told.append(f": {why}") if claim.why else told


def _print_statement(claim: Claim, console: Console) -> None:
    """A claim in words: what, verdict, and both sides on lines of their own."""
    told = Text.assemble(f"{about(claim)}   ", (claim.verdict, STYLES[claim.verdict]))
    console.print(Padding(told, (0, 0, 0, 2)))
    table = Table.grid(padding=(0, 2, 0, 0))
    table.add_column(width=5)
    table.add_column(overflow="fold")
    for side, said in (("paper", number(claim.paper)), ("ours", number(claim.ours)), ("why", claim.why)):
        if said:
            table.add_row(Text(side, "dim"), Text(said))
    console.print(Padding(table, (0, 0, 0, 4)))


def _claim_table(place: str, counted: str, width: int) -> Table:
    """An empty table whose columns stand at the same places for every table and figure."""
    table = Table(box=None, pad_edge=False, collapse_padding=True, padding=(0, 2, 0, 0), header_style="dim")
    value = STATEMENT if width < 110 else STATEMENT + 2
    room = max(width - 2 * value - 10 - 4 * 2, 40)
    table.add_column(Text(place, "bold not dim"), width=room * 2 // 5, overflow="fold")
    table.add_column("paper", width=value, justify="right", overflow="fold")
    table.add_column("ours", width=value, justify="right", overflow="fold")
    table.add_column("difference", width=10, justify="right", overflow="fold")
    table.add_column(Text(counted), width=room - room * 2 // 5, overflow="fold")
    return table


def _print_table(heading: str, rows: Sequence[Row], console: Console) -> None:
    """A table that is no comparison."""
    if not rows:
        return
    names = list(dict.fromkeys(name for row in rows for name in row))
    kept = names[:MOST_COLUMNS]
    shown = rows if len(rows) <= ROWS + 2 else rows[:ROWS]
    console.print()
    console.print(rich_table([{name: row.get(name) for name in kept} for row in shown], heading))
    left = [f"{len(rows) - len(shown)} rows"] * (len(shown) < len(rows))
    left += [f"{len(names) - len(kept)} columns"] * (len(kept) < len(names))
    if left:
        console.print(Text(f" and {' and '.join(left)} more in the files", "dim"))


def print_overview(r: Reproduction, console: Console) -> None:
    """Print what came of all chapters.

    Args:
        r: The reproduction.
        console: Where.
    """
    table = Table(box=SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    table.add_column("chapter", overflow="fold")
    for verdict, style in STYLES.items():
        table.add_column(SHORT[verdict][1], justify="right", style=style)
    table.add_column("figures", justify="right")
    table.add_column("time", justify="right")
    for done in r.chapters:
        table.add_row(*_overview(done.name, done.section), clock(done.seconds))
    console.print()
    console.print(Text(f"{r.source}: {tally(r.claims)}", "bold"))
    console.print(table)


def _overview(name: str, section: ChapterResult | None) -> list[Text]:
    """Title, counts and figures of a chapter."""
    if section is None:
        return [Text(f"{name}: failed", "bold red"), *[Text("–")] * (len(STYLES) + 1)]
    counts = [str(count) if count else "" for count in verdict_counts(section.claims).values()]
    return [Text(section.title), *map(Text, counts), Text(str(len(section.plots)))]
