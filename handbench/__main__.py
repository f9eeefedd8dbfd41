# PYTHON_ARGCOMPLETE_OK
"""The command line, as `handbench` and as `python -m handbench`."""

import sys


def main() -> int:
    """Run one command, and return the exit code. An interrupt while the command line is imported
    is one line too."""
    try:
        from handbench.cli.main import main as run

        return run()
    except KeyboardInterrupt:
        sys.stderr.write("handbench: interrupted\n")
        return 130


if __name__ == "__main__":
    sys.exit(main())
