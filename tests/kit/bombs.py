"""Bodies that are small packed and huge unpacked, made without ever being huge: peak memory is what tests look at."""

from __future__ import annotations

import gzip
import resource
import zlib

MIB = bytes(1 << 20)


def bomb(mib: int) -> bytes:
    """So many MiB of zeros in gzip, and that in gzip again."""
    packer = zlib.compressobj(9, wbits=31)
    packed = b"".join(packer.compress(MIB) for _ in range(mib)) + packer.flush()
    return gzip.compress(packed)


def peak_kb() -> int:
    """The most memory that this process ever had."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
