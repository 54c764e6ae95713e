"""Propose how a measured file is read, say why, and write the mapping.

``python scripts/import_recording.py --help`` tells more; ``manoeuvre import`` is the same.
"""

from manoeuvre_nn.commands.start import run

if __name__ == "__main__":
    run("import")
