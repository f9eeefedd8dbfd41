"""The command line as `python -m handbench`."""

import sys

from handbench.cli.main import main

sys.exit(main())
