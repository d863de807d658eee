"""A command that ends with its parent: ``python -m aeroskein_service.child run --config C``.

The parent holds the other end of standard input. However it dies, the pipe closes, and the command gets SIGTERM; so a
process tree never leaves anything behind, without help from the operating system.
"""

from __future__ import annotations

import os
import signal
import sys
import threading

from aeroskein_service.cli import main


def _end_with_parent() -> None:
    while os.read(0, 4096):
        pass
    os.kill(os.getpid(), signal.SIGTERM)


if __name__ == "__main__":
    threading.Thread(target=_end_with_parent, name="parent", daemon=True).start()
    main(sys.argv[1:])
