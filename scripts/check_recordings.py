"""What is wrong with measured files, before anything is fitted.

``python scripts/check_recordings.py --help`` tells more; ``manoeuvre check`` is the same.
"""

from manoeuvre_nn.commands.start import run

if __name__ == "__main__":
    run("check")
