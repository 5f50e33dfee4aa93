"""What all tests share."""

import os

# A console keeps the width that COLUMNS has when it is made; a test's own is to count.
os.environ.pop("COLUMNS", None)
import gpvo.commands.inputs  # noqa: F401
