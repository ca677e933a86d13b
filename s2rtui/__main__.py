"""`python -m s2rtui` is `s2r`."""

import sys

from s2rtui.cli import main

sys.exit(main())
