"""The networked shell around the fusion core: configuration, codec, Zenoh transport, commands."""

import os

# Before numpy is imported: the matrices here are too small for threads, which would only wait for each other and burn
# a second processor.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
