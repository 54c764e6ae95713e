"""Find out what a calm-water model leaves out of recorded manoeuvres.

``python diagnose.py --help`` tells more; ``manoeuvre diagnose`` is the same.
"""

from manoeuvre_nn.commands.start import run

if __name__ == "__main__":
    run("diagnose")
