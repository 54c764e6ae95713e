"""``python -m manoeuvre_nn COMMAND ...``: the command ``manoeuvre``, where its script is not on the path."""

from manoeuvre_nn.commands.start import main

if __name__ == "__main__":
    main()
