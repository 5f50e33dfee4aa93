"""A command that ends when the process does that started it, and keeps its input open.

python -m gpvo.commands.one_of_many run RECORDING ...

A worker that is killed cannot end what it started. Its recording is run again by another worker, in
the same folder.
"""

from __future__ import annotations

import os
from threading import Thread

from gpvo.commands.cli import main
from gpvo.commands.interruption import TERMINATED


def _end_with_the_input() -> None:
    while os.read(0, 1):  # not `sys.stdin`: its lock would be held when the interpreter ends
        pass
    os._exit(TERMINATED)


if __name__ == "__main__":
    Thread(target=_end_with_the_input, daemon=True).start()
    main()
