"""The command line as `python -m handbench`."""

import sys

from handbench.bench.cli.main import main

sys.exit(main())
