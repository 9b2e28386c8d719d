import subprocess
import sys

import pytest

_PROGRAM = """
import ctypes, sys
from app.allocator import return_large_blocks

class Facts(ctypes.Structure):
    _fields_ = [(f"fact{k}", ctypes.c_size_t) for k in range(10)]

def mapped():
    mallinfo = ctypes.CDLL(None).mallinfo2
    mallinfo.restype = Facts
    return mallinfo().fact3

assert return_large_blocks()
before = mapped()
# A block that was given back raises the size from which others are mapped, unless it is told not to.
bytearray(20_000_000)
block = bytearray(2_000_000)
sys.exit(mapped() - before)
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="a matter of glibc")
def test_large_blocks_are_mapped_one_by_one_whatever_was_given_back_before() -> None:
    assert subprocess.run([sys.executable, "-c", _PROGRAM], check=False).returncode == 1
