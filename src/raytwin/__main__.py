"""The program `raytwin`, and `python -m raytwin`."""

import sys

INTERRUPTED = 130
"""Exit code after Ctrl-C, as shells have it."""


def main() -> None:
    """Import the command line and run it. Ctrl-C during the import ends it as quietly as afterwards."""
    try:
        from raytwin.cli import main as run
    except KeyboardInterrupt:
        print("raytwin: interrupted", file=sys.stderr)
        sys.exit(INTERRUPTED)
    run()


if __name__ == "__main__":
    main()
