"""Coefficients with intervals from recordings, beside captive tests.

``python scripts/coefficients.py --help`` tells more; ``manoeuvre coefficients`` is the same.
"""

from manoeuvre_nn.commands.start import run

if __name__ == "__main__":
    run("coefficients")
