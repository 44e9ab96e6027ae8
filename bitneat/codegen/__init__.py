# SPDX-License-Identifier: MIT
"""From a controller to C: views, templates, names."""
