"""Which manoeuvre to sail next for this ship and model.

``python scripts/export.py --help`` tells more; ``manoeuvre export`` is the same.
"""

from manoeuvre_nn.commands.start import run

if __name__ == "__main__":
    run("export")
