# SPDX-License-Identifier: MIT
"""Evolution of controllers with neat-python: genome, search, run folder. Knows nothing of generated code."""
