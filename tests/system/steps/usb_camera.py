"""A USB camera for the kernel's virtual host controller (vhci_hcd), which is told of it through the usbip protocol
(Documentation/usb/usbip_protocol.rst): to everybody else it is a device like any other. Ending the program unplugs it.

Vendor 09cb, product 1007. Interface 0 has two alternate settings; setting 1 has the bulk endpoint 0x81, which never
sends.

usage: usb_camera.py [--serial TEXT]
"""

import argparse
import socket
import struct
from pathlib import Path

VENDOR, PRODUCT = 0x09CB, 0x1007
ENDPOINT = 0x81
PACKET = 512

PORT = 0
HIGH_SPEED = 3
CMD_SUBMIT, CMD_UNLINK, RET_SUBMIT, RET_UNLINK = 1, 2, 3, 4
EPIPE, ECONNRESET = 32, 104
STRINGS = {1: "FLIR", 2: "Virtual A655sc"}


def descriptors(serial: str) -> dict[int, bytes]:
    """By type and index, as in GET_DESCRIPTOR."""
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
    def __init__(self, connection: socket.socket, serial: str) -> None:
        self._connection = connection
        self._descriptors = descriptors(serial)
        self._waiting: list[int] = []  # sequence numbers of bulk requests

    def serve(self) -> None:
        while header := self._receive(48):
            self._handle(header)

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
            self._waiting.append(sequence)

    def _answer(self, sequence: int, status: int, data: bytes, actual: int) -> None:
        header = struct.pack(">5IiIIII8x", RET_SUBMIT, sequence, 0, 0, 0, status, actual, 0, 0, 0)
        self._connection.sendall(header + data)

    def _unlink(self, sequence: int, victim: int) -> None:
        still_there = victim in self._waiting
        self._waiting = [waiting for waiting in self._waiting if waiting != victim]
        status = -ECONNRESET if still_there else 0
        self._connection.sendall(struct.pack(">5Ii24x", RET_UNLINK, sequence, 0, 0, 0, status))

    def _control(self, setup: bytes) -> bytes | None:
        """Data of the answer; None: a stall."""
        kind, request, value, _, _ = struct.unpack("<BBHHH", setup)
        if kind & 0x60 == 0x40:  # vendor specific
            return None
        if request == 6:
            return self._descriptors.get(value)
        return {0: b"\0\0", 8: b"\1", 10: b"\0"}.get(request, b"")  # status, configuration, interface; all that sets


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--serial", default="V-1")
    arguments = parser.parse_args()
    camera, kernel = socket.socketpair()
    attach = Path("/sys/devices/platform/vhci_hcd.0/attach")
    attach.write_text(f"{PORT} {kernel.fileno()} {0x10001} {HIGH_SPEED}")
    kernel.close()  # the kernel has its own reference
    Camera(camera, arguments.serial).serve()


if __name__ == "__main__":
    main()
