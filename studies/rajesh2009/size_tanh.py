"""Rajesh & Bhattacharyya 2009, section 5.2.1 with networks as Table 2 shows them: tanh nodes, first rudder to port."""

from manoeuvre_nn.manoeuvre.zigzag import zigzag
from studies.rajesh2009.networks import Setting
from studies.rajesh2009.size import size_section
from studies.reproduction.section import ChapterResult, ComputingEffort, Say


def chapter(effort: ComputingEffort, say: Say) -> ChapterResult:
    """Section 5.2.1 with tanh nodes.

    Args:
        effort: How much computing is allowed.
        say: Told what is being done.

    Returns:
        Tolerances, epochs and Fig. 3 as distributions over the starts.
    """
    trained_on = zigzag(20.0, first="port", duration=1500.0)
    return size_section("tanh nodes", Setting(manoeuvre=trained_on, activation="tanh"), "port", {}, effort, say)
