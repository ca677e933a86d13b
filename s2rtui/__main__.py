"""`python -m s2rtui` is `s2r`.

The interpreter puts the working folder first in `sys.path` for `-m`; it leaves before anything else
is imported. Modules that the interpreter itself has imported by then may have come from there:
where the folder is not trusted, use `s2r` or `python -P -m s2rtui`.
"""

import sys

if not sys.flags.safe_path:
    del sys.path[0]

from s2rtui.cli import main

sys.exit(main())
