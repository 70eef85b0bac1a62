"""Back ends that turn graphs, or ordinary Python, into results: one module per kind of number or machine."""

import time

IMPORTED = time.time()
"""When the package was imported: this is its first module that is."""
