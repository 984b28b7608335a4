"""`python -m hairloom`."""

from .cli import main

raise SystemExit(main())
