"""Propose how a measured file is read, say why, and write the mapping.

    python scripts/import_recording.py FILE [ship=kvlcc2] [name=my_ship | out=my_ship.yaml] [overwrite=true]

FILE is a text of columns (csv, txt, dat), a MAT file or a parquet file. The yaml goes to FILE's name in this folder, to
out=, or with name= to conf/recording, where data.mapping= finds it. ship= tells units apart by the ship's speed.
"""

import sys
from pathlib import Path

from rich.console import Console

CONF = Path(__file__).resolve().parents[1] / "conf"


def main(arguments: list[str]) -> None:
    """Import a file.

    Args:
        arguments: The file and ``key=value``.
    """
    from manoeuvre_nn.entry import guard, import_job  # torch takes seconds: --help need not wait for it

    with guard.one_line():
        import_job.import_recording(
            import_job.request(arguments, CONF), CONF, Console(width=None if sys.stdout.isatty() else 130)
        )


if __name__ == "__main__":
    if {"-h", "--help"} & set(sys.argv[1:]):
        print(__doc__)
    else:
        main(sys.argv[1:])
