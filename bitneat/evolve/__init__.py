# SPDX-License-Identifier: MIT
"""Evolution of controllers with neat-python: genome, search, run folder. Knows nothing of generated code."""

from bitneat.callable import make_callable

make_callable(__name__)  # bitneat.evolve(...)
