"""`python -m realitygap`, and the `realitygap` script."""

import sys

__all__ = ["main"]


def main() -> None:
    """Run a command; Ctrl-C ends in one line even while the commands are being loaded."""
    try:
        from realitygap.cli import main as run
    except KeyboardInterrupt:
        sys.stderr.write("stopped\n")
        sys.exit(130)
    run()


if __name__ == "__main__":
    main()
