"""An independent reader of the shared memory, written from bolo/shm_layout.h; the reference for libbolo-client."""

import hashlib
import mmap
import os
import pathlib
import struct
import threading
import time

import numpy as np

MAGIC = 0x4D48534F4C4F42
HEADER = struct.Struct("<QIIIIIIQQQQddddIIII64s64s64sq")
SLOT = struct.Struct("<QQqqqIIdq")
PUBLISHED = 320


class Ring:
    """The present ring. Does not follow a new writer."""

    def __init__(self, name: str) -> None:
        path = pathlib.Path("/dev/shm") / f"bolo.{name}"
        with open(path, "rb") as file:
            self.inode = os.fstat(file.fileno()).st_ino
            self._memory = mmap.mmap(file.fileno(), 0, prot=mmap.PROT_READ)
        fields = HEADER.unpack_from(self._memory)
        magic, _, _, self.width, self.height, self._slots, _ = fields[:7]
        self._slots_offset, self._stride, self._raw, self._deblurred = fields[7:11]
        self.scale, self.offset = fields[11:13]
        self.writer_pid = fields[18]
        if magic != MAGIC:
            raise ValueError(f"{path}: not yet, or not, shared memory of bolod")

    def published(self) -> int:
        return struct.unpack_from("<Q", self._memory, PUBLISHED)[0]

    def frame(self, number: int) -> dict | None:
        """Frame `number` with copies of its planes; None: overwritten, or not published yet."""
        start = self._slots_offset + number % self._slots * self._stride
        wanted = 2 * number + 2
        slot = SLOT.unpack_from(self._memory, start)
        pixels = self.width * self.height
        raw = np.frombuffer(self._memory, np.uint16, pixels, start + self._raw).copy()
        deblurred = np.frombuffer(self._memory, np.uint16, pixels, start + self._deblurred).copy()
        if slot[0] != wanted or struct.unpack_from("<Q", self._memory, start)[0] != wanted:
            return None
        return {"number": number, "frame_id": slot[1], "publish_ns": slot[4], "raw": raw, "deblurred": deblurred}


def open_ring(name: str, limit_s: float = 20.0, other_than: int = 0) -> Ring:
    """Waits for a ring that has a frame and another inode."""
    deadline = time.monotonic() + limit_s
    while True:
        try:
            ring = Ring(name)
            if ring.inode != other_than and ring.published() > 0:
                return ring
        except (OSError, ValueError, struct.error):
            pass
        if time.monotonic() > deadline:
            raise TimeoutError(f"no frames in /dev/shm/bolo.{name} within {limit_s:g} s")
        time.sleep(0.01)


def published(name: str) -> int:
    """Frames published by the present writer; 0: no writer."""
    try:
        return Ring(name).published()
    except (OSError, ValueError, struct.error):
        return 0


def digest(plane: bytes | np.ndarray) -> bytes:
    return hashlib.blake2b(plane, digest_size=16).digest()


class Recorder:
    """Records the planes of all frames in a thread, to look up what other programs received."""

    def __init__(self, name: str) -> None:
        self._ring = open_ring(name)
        self.raw: dict[bytes, int] = {}
        self.deblurred: dict[bytes, int] = {}
        self.frames = 0
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        number = self._ring.published()
        stopped = False
        while not stopped:
            stopped = self._stop.wait(0.05)  # true: once more, for the latest frames
            while number < self._ring.published():
                frame = self._ring.frame(number)
                number += 1
                if frame is None:
                    continue
                self.raw[digest(frame["raw"])] = frame["number"]
                self.deblurred[digest(frame["deblurred"])] = frame["number"]
                self.frames += 1

    def stop(self) -> None:
        self._stop.set()
        self._thread.join()
