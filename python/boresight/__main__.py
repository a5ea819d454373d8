"""The command `boresight`."""

from __future__ import annotations

import signal
import sys


def main() -> int:
    """Carries the command line out and returns its exit code."""
    from ._boresight import command

    # The program listens for Ctrl-C itself.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    return command(["boresight", *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(main())
