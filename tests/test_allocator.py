import subprocess
import sys
from pathlib import Path

import pytest

_PROGRAM = """
import ctypes, sys, threading
from app.allocator import share_arenas

assert share_arenas()
ready = threading.Barrier(8)

def work():
    ready.wait()
    kept = [bytearray(10_000) for _ in range(200)]
    ready.wait()

threads = [threading.Thread(target=work) for _ in range(8)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
library = ctypes.CDLL(None)
library.fopen.restype = ctypes.c_void_p
file = ctypes.c_void_p(library.fopen(sys.argv[1].encode(), b"w"))
library.malloc_info(0, file)
library.fclose(file)
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="a matter of glibc")
def test_many_threads_share_few_stores_of_memory(tmp_path: Path) -> None:
    subprocess.run([sys.executable, "-c", _PROGRAM, str(tmp_path / "stores.xml")], check=True)
    assert (tmp_path / "stores.xml").read_text().count("<heap nr=") <= 2
