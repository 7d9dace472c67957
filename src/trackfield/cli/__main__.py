"""`python -m trackfield.cli` is `trackfield`."""

import sys

from trackfield.cli import main

sys.exit(main())
