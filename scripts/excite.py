"""Which manoeuvre to sail next for this ship and model.

``python scripts/excite.py --help`` tells more; ``manoeuvre excite`` is the same.
"""

from manoeuvre_nn.commands.start import run

if __name__ == "__main__":
    run("excite")
