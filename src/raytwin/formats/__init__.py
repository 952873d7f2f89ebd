"""Image files byte by byte, where no library does it safely: sizes checked before memory is taken.

Knows arrays, not Images: `files` gives them meaning, and is what others import.
"""

from raytwin.formats.exr import EXR_MAGIC, ExrPart, read_exr_header
from raytwin.formats.hdr import read_hdr
from raytwin.formats.limits import check_size
from raytwin.formats.pfm import pfm_bytes, read_pfm

__all__ = ["EXR_MAGIC", "ExrPart", "check_size", "pfm_bytes", "read_exr_header", "read_hdr", "read_pfm"]
