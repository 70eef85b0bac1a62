"""``python -m agents`` runs the application of this checkout."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from redundant_envs_train.__main__ import main

if __name__ == "__main__":
    sys.exit(main())
