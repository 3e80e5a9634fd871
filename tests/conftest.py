"""What holds for all tests: the outside plugin can be imported, and hypothesis has no deadlines.

The outside plugin's own tests are run where it is installed, in `test_strangers.py`.

In CI hypothesis tries the same examples every time.
"""

import os
import sys
from pathlib import Path

from hypothesis import settings

collect_ignore = ["outside/tests"]

sys.path.append(str(Path(__file__).parent / "outside"))

settings.register_profile("ci", derandomize=True, deadline=None)
settings.register_profile("here", deadline=None)
settings.load_profile("ci" if os.environ.get("CI") else "here")
