# SPDX-License-Identifier: MIT
"""What people read: figures of activations, runs and controllers."""
