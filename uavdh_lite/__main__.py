"""`python -m uavdh_lite`."""

import sys

from uavdh_lite.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
