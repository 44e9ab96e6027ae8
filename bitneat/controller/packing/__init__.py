# SPDX-License-Identifier: MIT
"""The packed form of a controller: bits, layout, encodings, blob."""

from bitneat.controller.packing.bits import PackedFormatError
from bitneat.controller.packing.blob import Blob, pack, pack_blob, shape_of, unpack
from bitneat.controller.packing.encodings import ENCODINGS
from bitneat.controller.packing.layout import Layout, SlotLink

__all__ = ["ENCODINGS", "Blob", "Layout", "PackedFormatError", "SlotLink", "pack", "pack_blob", "shape_of", "unpack"]
