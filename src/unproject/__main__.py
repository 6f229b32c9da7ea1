"""`python -m unproject` is the command `unproject`."""

import sys

from unproject.cli import main

if __name__ == "__main__":
    sys.exit(main())
