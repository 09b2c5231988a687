"""`python -m echolearn` is the command `echolearn`."""

import sys

from echolearn.cli.main import main

sys.exit(main())
