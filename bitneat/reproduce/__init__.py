# SPDX-License-Identifier: MIT
"""The experiments of the Bit-Pedal Walker paper: what runs, how the runs go on, and the tables and figures that they come to."""
