"""`python -m strand` is the command line."""

import sys

from strand.cli import main

sys.exit(main())
