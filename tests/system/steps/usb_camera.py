"""A USB camera for the kernel's virtual host controller (vhci_hcd), which is told of it through the usbip protocol
(Documentation/usb/usbip_protocol.rst): to everybody else it is a device like any other. Ending the program unplugs it.

Vendor 09cb, product 1007. Interface 0 has two alternate settings; setting 1 has the bulk endpoint 0x81. Vendor request
1 starts the stream, 2 ends it. A frame: "BOLO", its number (4 bytes, little-endian), 8 bytes of nothing, then the
pixels, which `pixels(number)` tells; a short packet ends it.

usage: usb_camera.py [--serial TEXT] [--rate HZ] [--first NUMBER]
"""

import argparse
import select
import socket
import struct
import time
from pathlib import Path

import numpy as np

WIDTH, HEIGHT = 64, 24
VENDOR, PRODUCT = 0x09CB, 0x1007
ENDPOINT = 0x81
PACKET = 512
HEADER_BYTES = 16
START, STOP = 1, 2

PORT = 0
HIGH_SPEED = 3
CMD_SUBMIT, CMD_UNLINK, RET_SUBMIT, RET_UNLINK = 1, 2, 3, 4
EPIPE, ECONNRESET = 32, 104
STRINGS = {1: "FLIR", 2: "Virtual A655sc"}


def pixels(number: int) -> np.ndarray:
    """What frame `number` shows: as no other does, around 300 K at 10 mK a count."""
    return np.random.default_rng(number).integers(29_000, 31_000, WIDTH * HEIGHT, dtype=np.uint16)


def descriptors(serial: str) -> dict[int, bytes]:
    """By type and index, as GET_DESCRIPTOR asks for them."""
    device = struct.pack("<BBHBBBBHHHBBBB", 18, 1, 0x200, 0, 0, 0, 64, VENDOR, PRODUCT, 0x100, 1, 2, 3, 1)
    idle = struct.pack("<BBBBBBBBB", 9, 4, 0, 0, 0, 0xFF, 0, 0, 0)
    streaming = struct.pack("<BBBBBBBBB", 9, 4, 0, 1, 1, 0xFF, 0, 0, 0)
    endpoint = struct.pack("<BBBBHB", 7, 5, ENDPOINT, 2, PACKET, 0)
    interfaces = idle + streaming + endpoint
    configuration = struct.pack("<BBHBBBBB", 9, 2, 9 + len(interfaces), 1, 1, 0, 0x80, 250) + interfaces
    strings = {0: struct.pack("<BBH", 4, 3, 0x0409)}
    for index, text in {**STRINGS, 3: serial}.items():
        encoded = text.encode("utf-16-le")
        strings[index] = struct.pack("<BB", 2 + len(encoded), 3) + encoded
    return {0x0100: device, 0x0200: configuration, **{0x0300 + index: text for index, text in strings.items()}}


class Camera:
    """Answers the host's requests (URBs), frames in their time."""

    def __init__(self, connection: socket.socket, serial: str, rate_hz: float, first: int) -> None:
        self._connection = connection
        self._descriptors = descriptors(serial)
        self._period_s = 1.0 / rate_hz
        self._number = first
        self._due_s: float | None = None  # of the next frame; None: not streaming
        self._waiting: list[tuple[int, int]] = []  # bulk requests: sequence number, bytes

    def serve(self) -> None:
        while True:
            wait_s = None if self._due_s is None else max(0.0, self._due_s - time.monotonic())
            if select.select([self._connection], [], [], wait_s)[0]:
                if not (header := self._receive(48)):
                    return
                self._handle(header)
            if self._due_s is not None and time.monotonic() >= self._due_s:
                self._send_frame()

    def _receive(self, size: int) -> bytes:
        return self._connection.recv(size, socket.MSG_WAITALL) if size else b""

    def _handle(self, header: bytes) -> None:
        command, sequence, _, direction, endpoint, _, length = struct.unpack_from(">7I", header)
        if command == CMD_UNLINK:
            return self._unlink(sequence, victim=struct.unpack_from(">I", header, 20)[0])
        sent = self._receive(length) if direction == 0 else b""
        if endpoint == 0:
            answer = self._control(header[40:48])
            status, data = (0, answer[:length]) if answer is not None else (-EPIPE, b"")
            self._answer(sequence, status, data if direction else b"", len(data) if direction else len(sent))
        else:
            self._waiting.append((sequence, length))

    def _answer(self, sequence: int, status: int, data: bytes, actual: int) -> None:
        header = struct.pack(">5IiIIII8x", RET_SUBMIT, sequence, 0, 0, 0, status, actual, 0, 0, 0)
        self._connection.sendall(header + data)

    def _unlink(self, sequence: int, victim: int) -> None:
        still_there = any(waiting == victim for waiting, _ in self._waiting)
        self._waiting = [request for request in self._waiting if request[0] != victim]
        status = -ECONNRESET if still_there else 0
        self._connection.sendall(struct.pack(">5Ii24x", RET_UNLINK, sequence, 0, 0, 0, status))

    def _control(self, setup: bytes) -> bytes | None:
        """The answer's data; None: a stall."""
        kind, request, value, _, _ = struct.unpack("<BBHHH", setup)
        if kind & 0x60 == 0x40:
            self._due_s = time.monotonic() + self._period_s if request == START else None
            return b"" if request in (START, STOP) else None
        if request == 6:
            return self._descriptors.get(value)
        return {0: b"\0\0", 8: b"\1", 10: b"\0"}.get(request, b"")  # status, configuration, interface; all that sets

    def _send_frame(self) -> None:
        """One that nobody waits for is lost, as in any camera."""
        number, self._number = self._number, self._number + 1
        self._due_s += self._period_s
        if self._waiting:
            sequence, length = self._waiting.pop(0)
            frame = struct.pack("<4sI8x", b"BOLO", number) + pixels(number).astype("<u2").tobytes()
            self._answer(sequence, 0, frame[:length], min(length, len(frame)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--serial", default="V-1")
    parser.add_argument("--rate", type=float, default=10.0)
    parser.add_argument("--first", type=int, default=0)
    arguments = parser.parse_args()
    camera, kernel = socket.socketpair()
    attach = Path("/sys/devices/platform/vhci_hcd.0/attach")
    attach.write_text(f"{PORT} {kernel.fileno()} {0x10001} {HIGH_SPEED}")
    kernel.close()  # the kernel has its own reference
    Camera(camera, arguments.serial, arguments.rate, arguments.first).serve()


if __name__ == "__main__":
    main()
