"""Extracts the ELF kernel from a bzImage: QEMU starts it at its PVH entry, which saves decompression in the machine.

usage: uncompress_kernel.py VMLINUZ VMLINUX
"""

import lzma
import pathlib
import sys

XZ_MAGIC = b"\xfd7zXZ\x00"


def main(source: str, target: str) -> None:
    image = pathlib.Path(source).read_bytes()
    start = image.find(XZ_MAGIC)
    if start < 0:
        sys.exit(f"{source}: no xz stream in it; a kernel compressed otherwise needs another way here")
    kernel = lzma.LZMADecompressor().decompress(image[start:])
    if kernel[:4] != b"\x7fELF":
        sys.exit(f"{source}: what it holds is no ELF file")
    pathlib.Path(target).write_bytes(kernel)


if __name__ == "__main__":
    main(*sys.argv[1:])
