"""What manoeuvre a rudder's history looks like."""

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.units import DEGREE

AMIDSHIPS = 1.0 * DEGREE
"""Rudder angles below this are no manoeuvre."""


def guess_kind(delta: Float[np.ndarray, " n"]) -> str:
    """Guess the kind of manoeuvre from the rudder angle alone.

    The rudder's *level* is what it stays below for 90 % of the time. A time during which it stays beyond 60 % of the
    level is an *execute*. Executes mostly at the level, on both sides and with little time between them, are a zigzag;
    on one side alone (course keeping before the turn set aside) they are a turning circle if they last to the end, and
    a pull-out if there is but one. Five or more held angles in falling and rising order are a spiral. Everything else
    is a random rudder.

    Args:
        delta: Rudder angle at even times [rad].

    Returns:
        ``straight``, ``zigzag``, ``turning_circle``, ``pull_out``, ``spiral`` or ``random_rudder``.
    """
    level = float(np.quantile(np.abs(delta), 0.9))
    if level < AMIDSHIPS:
        return "straight"
    if _is_spiral(delta, level):
        return "spiral"
    executes = np.flatnonzero(np.abs(delta) > 0.6 * level)
    over = delta[executes]
    held = np.abs(np.abs(over) - level) < max(0.15 * level, AMIDSHIPS)
    filled = len(over) / (executes[-1] - executes[0] + 1)
    share = max(np.mean(over > 0), np.mean(over < 0))
    if held.mean() < 0.7 or filled < 0.5:
        return "random_rudder"
    if share < 0.8:
        return "zigzag"
    if share < 0.9:
        return "random_rudder"
    end = float(np.median(delta[-max(len(delta) // 20, 1) :]))
    if abs(end) > 0.6 * level:
        return "turning_circle"
    return "pull_out" if filled > 0.9 else "random_rudder"


def _is_spiral(delta: Float[np.ndarray, " n"], level: float) -> bool:
    """Whether the rudder goes down and up a staircase of five or more steps."""
    steps: list[float] = []
    size = max(len(delta) // 40, 3)
    for begin in range(0, len(delta) - size + 1, size):
        piece = delta[begin : begin + size]
        still = np.ptp(piece) < 0.05 * level
        if still and (not steps or abs(np.median(piece) - steps[-1]) > 0.1 * level):
            steps.append(float(np.median(piece)))
    if len(steps) < 5:
        return False
    moves = np.diff(steps)
    turns = np.sum(np.sign(moves[1:]) != np.sign(moves[:-1]))
    return bool(turns <= 2 and np.max(np.abs(moves)) < 0.8 * level)
