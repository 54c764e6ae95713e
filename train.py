"""Train a neural model of a ship's manoeuvring and score it in closed loop.

``python train.py --help`` tells more; ``manoeuvre train`` is the same.
"""

from manoeuvre_nn.commands.start import run

if __name__ == "__main__":
    run("train")
